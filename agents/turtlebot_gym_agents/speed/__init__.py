"""The benchmark of speed: contenders that take turns, peers in environments of their own, and a guard against losses."""
