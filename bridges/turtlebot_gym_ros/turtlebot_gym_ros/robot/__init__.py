"""What runs on the robot itself, between whoever commands and the wheels."""
