"""Rooms: their obstacles, the shortest paths through them, and the ranges that a LiDAR measures in them."""
