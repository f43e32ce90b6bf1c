"""Drive episodes, replay recorded drives, and measure both."""
