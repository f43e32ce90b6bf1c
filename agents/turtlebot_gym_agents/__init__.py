"""Policies, their evaluation and training, and the command line.

Importing this package needs only Python, and its policies need only numpy, so that a robot can run them.
"""

from typing import TYPE_CHECKING

__all__ = ["BearingPolicy", "Deployment", "Policy", "ProportionalPolicy", "make_policy"]

if TYPE_CHECKING:
    from turtlebot_gym_agents.policies import BearingPolicy, Deployment, Policy, ProportionalPolicy, make_policy
else:

    def __getattr__(name):
        """Return a public name, imported at first use, so that --help does not wait for it."""
        if name not in __all__:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from turtlebot_gym_agents import policies

        return getattr(policies, name)
