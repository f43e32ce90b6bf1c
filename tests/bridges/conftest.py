"""The fixtures of live ROS nodes."""

from ros_fixtures import *  # noqa: F403
