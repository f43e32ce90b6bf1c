"""Entry point of ``ros2 run turtlebot_gym_ros NODE``; each executable of the ROS package is named like its node."""

import sys
from pathlib import Path

from turtlebot_gym_ros.__main__ import main as run_node


def main() -> int:
    """Run the node with the name of this program."""
    return run_node([Path(sys.argv[0]).name, *sys.argv[1:]])
