"""Configuration of a training run; separate from the training, so that it is checked before torch is imported."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
from gymnasium.envs.registration import registry
from gymnasium.vector import AutoresetMode, VectorEnv

from turtlebot_gym import Robot
from turtlebot_gym.files import load
from turtlebot_gym.validation import NON_NEGATIVE, Range, choose, flag, shown, whole
from turtlebot_gym_agents.training.randomization import SPEED_ERROR, randomized

MAX_STEPS = 10**12
"""Most steps of a training."""
DEVICES = ("cpu", "cuda", "auto")


@dataclass(frozen=True, kw_only=True)
class TrainingConfig:
    """Configuration of a training run."""

    env: str = "turtlebot_gym/TurtleBotNav-v0"
    """Environment id."""
    algo: str = "ppo"
    """Algorithm of Stable-Baselines3, in lower case."""
    seed: int = 0
    """Seed of the network, from which the environments' seeds follow."""
    robot: str | Robot = "burger"
    """Robot preset, or a robot."""
    noise: str = "tutorial"
    """Noise preset."""
    filter: str = "matched"
    """Filter preset."""
    observation: str = "ekf"
    """The robot's pose that the policy observes: ekf, odometry or truth."""
    arrival: str = "truth"
    """Pose that decides on arrival: truth or belief."""
    delay: int = 0
    """Delay of commands in steps."""
    fix: str | None = None
    """External pose sensor; None for none."""
    world: str | None = None
    """In rooms: the world; None for the environment's own."""
    lidar: str | None = None
    """In rooms: the LiDAR; None for the environment's own."""
    randomize: bool = False
    """Whether noise, speed scale and delay (in rooms also world and LiDAR) are randomized per environment, see `randomization`;
    ``noise``, ``filter``, ``delay``, ``world`` and ``lidar`` are then those of the evaluation."""
    speed_error: float = SPEED_ERROR
    """With ``randomize``: largest error of the executed speed, as a share of it."""
    steps: int | None = None
    """Environment steps; None for n_timesteps of the hyper-parameters."""
    config: Path | None = None
    """Hyper-parameters, YAML; None for those shipped with the package."""
    evaluations: int = 8
    """Number of evaluations during training."""
    episodes: int = 500
    """Episodes of each evaluation."""
    checkpoint_seconds: float = 5.0
    """Least time between two checkpoints, s."""
    device: str = "cpu"
    """Device of the network: cpu, cuda or auto, see `devices.choose_device`."""
    threads: int = 1
    """Threads of torch and of the compiled loop; small networks gain nothing from more."""

    def __post_init__(self) -> None:
        if self.steps is not None:
            whole("steps", self.steps, 1, MAX_STEPS)
        for name, most in (("evaluations", MAX_STEPS), ("episodes", 1_000_000), ("threads", 4096)):
            whole(name, getattr(self, name), 1, most)
        whole("seed", self.seed, 0, 2**20 - 1)
        flag("randomize", self.randomize)
        choose("device", self.device, dict.fromkeys(DEVICES))
        Range(0.0, 1.0, open_high=True).check("speed_error", self.speed_error)
        NON_NEGATIVE.check("checkpoint_seconds", self.checkpoint_seconds)
        if not isinstance(self.env, str) or self.env not in registry:
            known = ", ".join(repr(spec.id) for spec in registry.values() if spec.namespace == "turtlebot_gym")
            raise ValueError(f"env must be one of {known}, or another id with their arguments, got {shown(self.env)}.")

    def make(self, num_envs: int, *, randomize: bool = False) -> VectorEnv:
        """Return environments; with ``randomize`` they differ from each other."""
        names = ("robot", "noise", "filter", "observation", "arrival", "delay", "fix", "world", "lidar")
        envs = gym.make_vec(
            self.env,
            num_envs=num_envs,
            vectorization_mode="vector_entry_point",
            autoreset_mode=AutoresetMode.SAME_STEP,
            **{name: value for name in names if (value := getattr(self, name)) is not None},
        )
        if randomize:
            bare: Any = envs.unwrapped
            bare.set_parameters(randomized(bare.parameters, num_envs, seed=self.seed, speed_error=self.speed_error))
        return envs


def require_no_run(folder: Path) -> None:
    """Raise ValueError if a folder holds a run, which only resuming may change."""
    if (folder / "checkpoint.zip").exists():
        raise ValueError(f"{folder} holds a run already: resume it with --resume, or choose another folder.")


def read_record(path: Path) -> dict[str, Any]:
    """Return what a training has left in its config.json.

    Raises:
        ValueError: If it is something else.
    """
    record = load(path)
    if not isinstance(record, dict) or not isinstance(record.get("config", {}), dict):
        raise ValueError(f"{path} must be what training leaves: a mapping with a mapping under 'config'.")
    return record


FREE_TO_CHANGE = ("steps", "config", "evaluations", "episodes", "checkpoint_seconds", "device", "threads")
"""Fields of the configuration that may differ when a run is resumed; the contents of the file ``config`` may not."""
