"""Policies, their evaluation and training, and the command line.

Importing this package needs numpy alone, so that a robot can run the policies.
"""

from turtlebot_gym_agents.policies import BearingPolicy, Policy, ProportionalPolicy, make_policy

__all__ = ["BearingPolicy", "Policy", "ProportionalPolicy", "make_policy"]
