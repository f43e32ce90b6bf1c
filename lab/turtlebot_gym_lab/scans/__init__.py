"""The map of a drive, by its scans."""
