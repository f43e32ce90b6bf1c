"""Defaults that commands and Python functions share; importing this module needs only Python."""

NAV = "nav"
"""Environment, see `turtlebot_gym_agents.ids`."""
POLICIES = ("proportional", "bearing")
"""Policies of a comparison."""
DRIVER = "bearing"
"""Policy of a drive."""
EPISODES = 1000
"""Episodes of an evaluation."""
SEED = 0
"""First seed."""
SEEDS = 1
"""Trainings."""
RUN = "runs/nav"
"""Folder of a training."""
BUNDLE = "policy.onnx"
"""File of an exported policy."""
