"""Policies, their evaluation and training, and the command line, which is also here in Python.

    from turtlebot_gym_agents import compare, train

    print(compare(train("nav", "runs/a", steps=200_000), "bearing"))

Importing this package needs only Python, and its policies need only numpy, so that a robot can run them.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

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
    from turtlebot_gym_agents.front.learning import Training, train
    from turtlebot_gym_agents.front.satellites import replay, watch
    from turtlebot_gym_agents.policies import BearingPolicy, Deployment, Policy, ProportionalPolicy, make_policy
    from turtlebot_gym_agents.training.export import ExportedPolicy, export

_HOMES = {
    "evaluation.evaluate": ("evaluate",),
    "evaluation.result": ("Evaluation",),
    "front.comparing": ("Comparison", "compare"),
    "front.driving": ("DriveResult", "drive"),
    "front.learning": ("Training", "train"),
    "front.satellites": ("replay", "watch"),
    "training.export": ("ExportedPolicy", "export"),
    "policies": ("BearingPolicy", "Deployment", "Policy", "ProportionalPolicy", "make_policy"),
}
_HOME_OF = {name: module for module, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Return a public name, imported at first use: --help does not wait for it, and commands first set up their threads."""
    if name not in _HOME_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME_OF[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
