"""Policies of other libraries as bundles: ``export``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from turtlebot_gym_agents.front.defaults import BUNDLE

if TYPE_CHECKING:
    from turtlebot_gym_agents.policies.bundle import Card

_PARTS = {
    "normalization": "normalized",
    "a stack of observations": "frame_stack",
    "the state of a recurrent network": "state",
}
"""Parts of a bundle as its maker is told of them, and their entries on the card."""


@dataclass(frozen=True, kw_only=True, repr=False)
class ExportedPolicy:
    """A bundle that acts as the policy it was made of; `evaluate` and `compare` take it for its policy."""

    policy: Path
    """The bundle."""
    difference: float
    """Largest difference between its actions and the library's."""
    steps: int
    """Steps of each environment in which they were compared."""
    rows: int
    """Number of these environments."""

    @property
    def card(self) -> Card:
        """The card: what the policy was trained for."""
        from turtlebot_gym_agents.policies.bundle import BundlePolicy

        return BundlePolicy(self.policy).card

    def __str__(self) -> str:
        card = self.card
        parts = "".join(f", with {name}" for name, there in _PARTS.items() if card.training.get(there))
        return (
            f"{self.policy}: {self.policy.stat().st_size:,} bytes, for {card.env}{parts}; its actions differ from the "
            f"library's by at most {self.difference:.1g} over {self.steps:,} steps of {self.rows} environments."
        )

    __repr__ = __str__


def export(model: Any, path: str | Path = BUNDLE, *, env: str | None = None, **options: Any) -> ExportedPolicy:
    """Write a policy of another library as a bundle, if both return the same actions.

    Args:
        model: A model of Stable-Baselines3 or sb3-contrib, a torch module, an ONNX model, or a file, see
            `training.export.export`.
        path: The bundle's file; an existing one is replaced.
        env: Id or short name of the environment that it was trained in; None for what the model says, else Nav.
        **options: Further arguments of `training.export.export`: ``vec_normalize``, ``allow_pickle``, the environment's, ...

    Raises:
        ValueError: If the policy cannot be a bundle; the message says what to do.
        RuntimeError: If the actions differ.
        ImportError: If a library is missing.
    """
    from turtlebot_gym_agents.commands.console import needs

    with needs("agents"):
        from turtlebot_gym_agents.training.export import export as write
        from turtlebot_gym_agents.training.network import ROWS, STEPS
    difference = write(model, path, env=env, **options)
    return ExportedPolicy(policy=Path(path), difference=difference, steps=options.get("steps", STEPS), rows=ROWS)
