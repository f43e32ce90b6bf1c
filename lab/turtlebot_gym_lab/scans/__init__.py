"""What a drive's scans say without a map: how a LiDAR moved from one to the other, wheels and mount, and a map."""
