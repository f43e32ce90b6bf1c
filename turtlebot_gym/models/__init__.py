"""The physics as pure functions: motion, odometry, and the counter-based noise for both."""
