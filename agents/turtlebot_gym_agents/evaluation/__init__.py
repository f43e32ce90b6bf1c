"""Drive episodes, and measure them."""
