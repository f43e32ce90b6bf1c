"""Rooms with obstacles: what stands in them, the ways through them, and what a LiDAR sees of them."""
