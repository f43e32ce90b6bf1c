"""The fixtures of live ROS nodes: see `tests/bridges/ros_fixtures.py`."""

from ros_fixtures import *  # noqa: F403
