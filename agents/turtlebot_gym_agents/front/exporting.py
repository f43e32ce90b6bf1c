"""Policies of other libraries as bundles: ``export``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

from turtlebot_gym import Options
from turtlebot_gym_agents.commands.console import needs
from turtlebot_gym_agents.flags import Text, takes
from turtlebot_gym_agents.outputs import OutputFile, require_outputs

if TYPE_CHECKING:
    from turtlebot_gym_agents.policies.bundle import Card

_PARTS = {
    "normalization": "normalized",
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


@takes(Options, "task")
def export(
    model: tyro.conf.Positional[Text],
    out: str | Path = "policy.onnx",
    *,
    env: str | None = None,
    vec_normalize: tyro.conf.Suppress[Any] = None,
    memory: tyro.conf.Suppress[int] = 0,
    training: tyro.conf.Suppress[Any] = None,
    steps: tyro.conf.Suppress[int] = 1000,
    allow_pickle: bool = False,
    force: bool = True,
    **options: Any,
) -> ExportedPolicy:
    """Make a policy bundle, and check that it returns the same actions, in the environment of the training.

    Args:
        model: The folder of a training by this package, a model in it (.zip), or an ONNX model (.onnx) from observations to
            actions; in Python also a model of Stable-Baselines3 or sb3-contrib, or a torch module, see `training.export`.
        out: The bundle.
        env: Id or short name of the environment that it was trained in; None for what the model says, else nav.
        vec_normalize: What normalized observations; "none" for nothing, None for what the model's environment has.
        memory: Of a torch module with a state: how many numbers that has.
        training: Entries of the card about the training.
        steps: Steps of the check.
        allow_pickle: Confirm that you trust the file: loading a .zip can run any code in it.
        force: Overwrite a bundle that exists.
        **options: The environment's of the training, see `turtlebot_gym.Options`.

    Raises:
        ValueError: If the policy cannot be a bundle; the message says what to do.
        RuntimeError: If the actions differ.
        ImportError: If a library is missing.
    """
    require_outputs([("--out", out, OutputFile((".onnx",)))], force=force)
    with needs("agents"):
        from turtlebot_gym_agents.training.export import export as write
        from turtlebot_gym_agents.training.network import ROWS
    given: dict[str, Any] = {"env": env, "vec_normalize": vec_normalize, "memory": memory, "training": training}
    difference = write(model, out, **given, steps=steps, allow_pickle=allow_pickle, **options)
    return ExportedPolicy(policy=Path(out), difference=difference, steps=steps, rows=ROWS)
