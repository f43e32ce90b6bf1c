"""Localization of a robot in a known map, from wheel odometry and LiDAR scans: for simulations, nodes and recordings."""
