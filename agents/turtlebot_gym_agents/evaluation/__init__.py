"""Driving episodes and recorded drives, and measuring them."""
