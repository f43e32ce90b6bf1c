"""Replay and localize recorded drives, and compare filters."""
