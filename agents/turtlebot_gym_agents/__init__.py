"""Policies, their evaluation and training, and the command line, which is also here in Python.

    from turtlebot_gym_agents import compare, train

    print(compare(train("nav", "runs/a", steps=200_000), "bearing"))

Importing this package needs only Python, and its policies need only numpy, so that a robot can run them.
"""

from typing import TYPE_CHECKING

from turtlebot_gym.lazy import lazy_names

__all__ = [
    "BearingPolicy",
    "Comparison",
    "Deployment",
    "DriveResult",
    "Evaluation",
    "ExportedPolicy",
    "Policy",
    "ProportionalPolicy",
    "Training",
    "compare",
    "drive",
    "evaluate",
    "export",
    "make_policy",
    "replay",
    "train",
    "watch",
]

if TYPE_CHECKING:
    from turtlebot_gym_agents.evaluation.evaluate import evaluate
    from turtlebot_gym_agents.evaluation.result import Evaluation
    from turtlebot_gym_agents.front.comparing import Comparison, compare
    from turtlebot_gym_agents.front.driving import DriveResult, drive
    from turtlebot_gym_agents.front.exporting import ExportedPolicy, export
    from turtlebot_gym_agents.front.learning import Training, train
    from turtlebot_gym_agents.front.satellites import replay, watch
    from turtlebot_gym_agents.policies import BearingPolicy, Deployment, Policy, ProportionalPolicy, make_policy
else:  # import names at first use, so that --help does not wait for them
    _HOMES = {
        "evaluation.evaluate": ("evaluate",),
        "evaluation.result": ("Evaluation",),
        "front.comparing": ("Comparison", "compare"),
        "front.driving": ("DriveResult", "drive"),
        "front.exporting": ("ExportedPolicy", "export"),
        "front.learning": ("Training", "train"),
        "front.satellites": ("replay", "watch"),
        "policies": ("BearingPolicy", "Deployment", "Policy", "ProportionalPolicy", "make_policy"),
    }
    __getattr__, __dir__ = lazy_names(__name__, _HOMES)
