"""Commands that ask and tell a live graph, for machines without ros2cli; where ros2cli is installed, use that."""
