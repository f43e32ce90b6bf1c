"""The guard's tests use the harness of the bridge's."""

from ros_fixtures import *  # noqa: F403  (fixtures)
