"""The subcommands that make and describe policy bundles: ``export`` and ``card``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, ClassVar

import tyro

from turtlebot_gym.config import BASE, POSITIVE
from turtlebot_gym.files import write_text
from turtlebot_gym_agents.commands.console import WritingOptions
from turtlebot_gym_agents.commands.overrides import Hidden, Overridable
from turtlebot_gym_agents.front.defaults import BUNDLE
from turtlebot_gym_agents.outputs import OutputFile


@dataclass(frozen=True, kw_only=True)
class Export(WritingOptions, Overridable):
    """Make a policy bundle of a training's best model or of an ONNX model, and check that both return the same actions.

    The check drives in the environment of the training, which the config.json beside a model names; of an ONNX model, the
    options do. Models of other libraries are exported in Python, by export(model, ...).
    """

    EXAMPLE: ClassVar = "world=office dt=0.05 noise.odometry.spike=0.1"

    model: tyro.conf.Positional[Path]
    """The folder of a training by this package, a model in it (.zip), or an ONNX model (.onnx) from observations to actions."""
    out: Annotated[Path, OutputFile((".onnx",))] = Path(BUNDLE)
    """The bundle."""
    allow_pickle: bool = False
    """Confirm that you trust the file: loading a .zip can run any code in it."""
    env: str | None = None
    """Environment: nav, pose, square, rooms, missions, or the id of another one; by default the one that the folder names, else
    nav."""
    robot: str | None = None
    """Robot of the training: a preset, or a file of your own (FILE.yaml)."""
    noise: str | None = None
    """Noise of the training: clean, tutorial, documented, wheel, rough, or a file of your own (FILE.yaml)."""
    filter: str | None = None
    """Filter of the training: matched, calibrated, tutorial, gated, gyro, or your own (MODULE:NAME)."""
    observation: str | None = None
    """What the policy observed: ekf, odometry, truth or located, with terms after it, see train --help-all."""
    rate: float | None = None
    """Commands per second; by default 10 unless config.json says otherwise."""
    others: Hidden = field(default_factory=dict)
    """Further options of the environment, by name."""

    def varied(self, options: Mapping[str, Any]) -> dict[str, Any]:
        """Return options with the changed fields; `training.export.export` takes what is not given from the training."""
        changed = {name: {BASE: options.get(name), **changes} for name, changes in self.changes.items()}
        return {**options, **changed}

    def take(self, name: str, unknown: Mapping[str, Any]) -> dict[str, Any]:
        """Return further options of the environment; see `commands.overrides.Overridable.take`."""
        from turtlebot_gym import Options

        known = {item.name for item in fields(Options)}
        others = {key: value for key, value in unknown.items() if key in known}
        if len(others) < len(unknown):
            super().take(name, {key: value for key, value in unknown.items() if key not in known})
        return {"others": others}

    def run(self) -> None:
        from rich.console import Console

        from turtlebot_gym_agents.front.exporting import export

        names = ("robot", "noise", "filter", "observation")
        options = {name: value for name in names if (value := getattr(self, name)) is not None} | dict(self.others)
        if self.rate is not None and "dt" in options:
            raise ValueError("rate and dt exclude each other: leave out one of them.")
        if self.rate is not None:
            options["dt"] = 1.0 / POSITIVE.check("rate", self.rate)
        given = {"env": self.env, "allow_pickle": self.allow_pickle}
        Console().print(str(export(self.model, self.out, **given, **self.varied(options))))


@dataclass(frozen=True, kw_only=True)
class ShowCard(WritingOptions):
    """Write a policy's card as a page in Markdown, in the form of model hubs: purpose, training and results."""

    policy: tyro.conf.Positional[str]
    """A bundle (FILE.onnx), or a policy shipped with the package, such as ppo-nav."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE.md"), OutputFile((".md",))] = None
    """Write the page here; by default it is printed."""

    def run(self) -> None:
        from turtlebot_gym_agents.policies.model_card import model_card
        from turtlebot_gym_agents.policies.named import bundle_of

        path = bundle_of(self.policy)
        if path is None:
            raise ValueError(f"policy must be a bundle, FILE.onnx, or a trained policy of the package, got {self.policy!r}.")
        page = model_card(path)
        if self.out is None:
            print(page, end="")
        else:
            write_text(self.out, page)
