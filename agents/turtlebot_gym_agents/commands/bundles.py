"""The subcommands that make and describe policy bundles: ``export`` and ``card``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from turtlebot_gym.files import write_text
from turtlebot_gym_agents.commands.console import WritingOptions, needs
from turtlebot_gym_agents.outputs import OutputFile


@dataclass(frozen=True, kw_only=True)
class Export(WritingOptions):
    """Convert a model saved by Stable-Baselines3 into a policy bundle, and check that both return the same actions.

    The settings of its training are read from the config.json beside it; without that file, give them as options.
    """

    model: tyro.conf.Positional[Path]
    """The model, a zip file."""
    out: Annotated[Path, OutputFile((".onnx",))] = Path("policy.onnx")
    """The bundle."""
    allow_pickle: bool = False
    """Confirm that you trust the zip file: loading it can run any code in it."""
    env: str | None = None
    """The environment's id."""
    robot: str | None = None
    """Robot of the training: a preset, or a file of your own (FILE.yaml)."""
    noise: str | None = None
    """Noise of the training: clean, tutorial, documented, wheel, rough, or a file of your own (FILE.yaml)."""
    filter: str | None = None
    """Filter of the training: matched, calibrated, tutorial, gated, mixture, slip, scale, gyro, or your own (MODULE:NAME)."""
    observation: str | None = None
    """What the policy observed: ekf, odometry, truth or located, with terms after it, see train --help."""
    rate: float | None = None
    """Commands per second; by default 10 unless config.json says otherwise."""

    def run(self) -> None:
        with needs("agents"):
            from turtlebot_gym_agents.policies import bundle
            from turtlebot_gym_agents.policies.fit import describe_robot
            from turtlebot_gym_agents.training.config import TrainingConfig, read_record
            from turtlebot_gym_agents.training.export import export, load_model
        from rich.console import Console

        model = load_model(self.model, allow_pickle=self.allow_pickle)
        beside = self.model.parent / "config.json"
        record = read_record(beside) if beside.is_file() else {}
        default = TrainingConfig().settings() | record.get("config", {})

        def setting(name: str) -> Any:
            value = getattr(self, name)
            return default[name] if value is None else value

        robot, env = setting("robot"), setting("env")
        pose, terms = bundle.observed(env, setting("observation"))
        card = bundle.Card(
            env=env,
            robot=describe_robot(robot) if isinstance(robot, str) else {"name": "custom", **robot},
            dt=0.1 if self.rate is None else 1.0 / self.rate,
            noise="randomized" if default["randomize"] and self.noise is None else setting("noise"),
            filter=setting("filter"),
            observation=pose,
            terms=bundle.described(terms),
            training={**record, "steps": model.num_timesteps},
        )
        difference = export(model, self.out, card)
        Console().print(
            f"{self.out}: {self.out.stat().st_size:,} bytes; its actions differ from the model's by at most "
            f"{difference:.1g} on 10,000 observations."
        )


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
