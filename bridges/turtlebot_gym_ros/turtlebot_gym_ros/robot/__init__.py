"""Software on the robot itself, between commands and wheels."""
