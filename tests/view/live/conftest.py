"""The fixtures of live ROS nodes: those of `tests/bridges`, whose folder is on the path."""

from conftest import *  # noqa: F403
