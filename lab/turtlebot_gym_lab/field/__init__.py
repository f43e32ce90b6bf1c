"""The first afternoon with a robot: what it sends, whether it stops, how far it drives, and a report of it on one page."""
