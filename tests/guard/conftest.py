"""The guard's tests use the harness of the bridge's."""

import guarded  # noqa: F401  (it names the robots)
from ros_fixtures import *  # noqa: F403  (fixtures)
