"""Policies: geometric laws, trained bundles, and their lookup by name."""

from turtlebot_gym_agents.policies.deployment import Deployment
from turtlebot_gym_agents.policies.geometric import BearingPolicy, CornerPolicy, ProportionalPolicy
from turtlebot_gym_agents.policies.named import POLICIES, make_policy
from turtlebot_gym_agents.policies.policy import Policy, PolicyWithMemory, terms_of

__all__ = [
    "POLICIES",
    "BearingPolicy",
    "CornerPolicy",
    "Deployment",
    "Policy",
    "PolicyWithMemory",
    "ProportionalPolicy",
    "make_policy",
    "terms_of",
]
