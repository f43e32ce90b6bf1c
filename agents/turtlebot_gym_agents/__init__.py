"""Policies, their evaluation and training, and the command line, which is also here in Python.

    from turtlebot_gym_agents import compare, train

    print(compare(train("nav", "runs/a", steps=200_000), "bearing"))

Importing this package needs only Python, and its policies need only numpy, so that a robot can run them.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

__all__ = ["BearingPolicy", "Deployment", "Policy", "ProportionalPolicy", "make_policy"]
__all__ += ["compare", "drive", "evaluate", "export", "replay", "train", "watch"]

if TYPE_CHECKING:
    from turtlebot_gym_agents.evaluation.evaluate import evaluate
    from turtlebot_gym_agents.front.comparing import compare
    from turtlebot_gym_agents.front.driving import drive
    from turtlebot_gym_agents.front.learning import train
    from turtlebot_gym_agents.front.satellites import replay, watch
    from turtlebot_gym_agents.policies import BearingPolicy, Deployment, Policy, ProportionalPolicy, make_policy
    from turtlebot_gym_agents.training.export import export

_HOMES = {
    "compare": "front.comparing",
    "drive": "front.driving",
    "evaluate": "evaluation.evaluate",
    "export": "training.export",
    "replay": "front.satellites",
    "train": "front.learning",
    "watch": "front.satellites",
}
"""Modules of names that are not in ``policies``."""


def __getattr__(name: str) -> Any:
    """Return a public name, imported at first use: --help does not wait for it, and commands first set up their threads."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES.get(name, 'policies')}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
