"""Tracking of what moves: from scans to bodies, tracks with their covariances, and numbers for a policy."""
