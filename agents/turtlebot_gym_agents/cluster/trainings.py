"""Trainings of several seeds, or of several configurations, as units of work."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from turtlebot_gym.files import load, replacing
from turtlebot_gym_agents.cluster.attachments import Attachments, attach, hashes, placed, unpacked
from turtlebot_gym_agents.cluster.units import Result, Runner, complete
from turtlebot_gym_agents.provenance import replace_json
from turtlebot_gym_agents.training.config import TrainingConfig, require_no_run

if TYPE_CHECKING:
    from turtlebot_gym_agents.training.train import TrainingResult

KEPT = ("policy.onnx", "best.zip", "config.json", "result.json")
"""Files that return from a training's folder; checkpoints stay where they were made."""


@dataclass(frozen=True, kw_only=True)
class Training:
    """The training of a policy: a unit of work, see `units`."""

    config: TrainingConfig
    """Configuration of the training."""
    files: Attachments = field(default_factory=dict)
    """Files that the configuration names."""
    memory = 1200 * 2**20
    size = 1

    @classmethod
    def of(cls, config: TrainingConfig) -> Training:
        """Return the unit of a training, with the files that its configuration names."""
        return cls(config=config, files=attach(*config.options.values()))

    def about(self) -> dict[str, Any]:
        settings = self.config.settings()
        config = {name: value for name, value in settings.items() if name not in ("config", "checkpoint_seconds")}
        return {"training": config, "hyperparameters": dict(self.config.hyper), "files": hashes(self.files)}

    def located(self, places: Mapping[str, str]) -> TrainingConfig:
        """Return the configuration with the local paths of files that were sent along."""
        options = {name: placed(value, places) for name, value in self.config.options.items()}
        return replace(self.config, config=self.config.hyper, **options)

    def run(self) -> Result:
        from turtlebot_gym_agents.training.train import train

        with unpacked(self.files) as places, TemporaryDirectory(prefix="turtlebot-gym-") as name:
            folder = Path(name)
            result = train(self.located(places), folder, progress=False)
            record = load(folder / "config.json")
            record["config"] = self.config.settings()  # with the files' original names, not the unpacked paths
            replace_json(folder / "config.json", record)
            files = {file: (folder / file).read_bytes() for file in KEPT}
        facts = {"steps": result.steps, "best": dict(result.best), "history": result.history}
        return Result(facts, {}, files, {"training": result.seconds, "steps_per_second": result.steps_per_second})


def train_all(
    configs: Sequence[TrainingConfig],
    folders: Sequence[Path],
    *,
    runner: Runner = complete,
    progress: Callable[[int], None] = lambda done: None,
) -> Iterator[TrainingResult]:
    """Train policies, and write the files of `training.train.train` except checkpoints and logs.

    Args:
        configs: Configurations of the trainings.
        folders: Folder for the files of each.
        runner: Runs the units of work.
        progress: Called with the number of finished trainings.

    Raises:
        ValueError: As `training.train.train`, and if a folder holds a run that was trained here.
    """
    from turtlebot_gym_agents.training.train import TrainingResult

    for folder in folders:
        require_no_run(folder)
    units = [Training.of(config) for config in configs]
    for folder, result in zip(folders, runner(units, progress), strict=True):
        for name, content in result.files.items():
            with replacing(folder / name) as beside:
                beside.write_bytes(content)
        times = {"seconds": result.times["training"], "steps_per_second": result.times["steps_per_second"]}
        yield TrainingResult(**result.facts, **times)
