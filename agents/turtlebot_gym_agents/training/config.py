"""Configuration of a training run, checked when it is made; it needs no torch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from shutil import rmtree
from typing import Annotated, Any

import gymnasium as gym
from gymnasium.envs.registration import registry
from gymnasium.vector import AutoresetMode, VectorEnv

from turtlebot_gym import Options
from turtlebot_gym.config import NON_NEGATIVE, Range, check_fields, choose, did_you_mean, refusal
from turtlebot_gym_agents.ids import arguments_of, environment_id
from turtlebot_gym_agents.provenance import plain, provenance
from turtlebot_gym_agents.training import hyperparameters
from turtlebot_gym_agents.training.randomization import randomized

STEPS = Range(1, 10**12, whole=True)
"""Steps of a training, and evaluations of one."""
NAMES = ("a2c", "ddpg", "ppo", "sac", "td3")
"""Algorithms of Stable-Baselines3 that train here, in lower case."""
ROWS = 128
"""Most environments of an evaluation."""
RANDOMIZED = ("speed_error", "turn_error", "veer")
"""Fields that ``randomize`` reads."""


@dataclass(frozen=True, kw_only=True)
class TrainingConfig(Options):
    """Configuration of a training run, which says everything that its result depends on, with the options of its environments.

    With ``randomize`` those of noise, filter, delay, world and LiDAR are for the evaluation.
    """

    env: str = "nav"
    """Environment id, or its short name."""
    algo: str = "ppo"
    """Algorithm: ppo, sac or td3; others of Stable-Baselines3, in lower case, with a FILE of hyper-parameters."""
    seed: Annotated[int, Range(0, 2**20 - 1, whole=True)] = 0
    """Seed of the network, from which the environments' seeds follow."""
    randomize: bool = False
    """Randomize noise, speed scale and delay (in rooms also world and LiDAR) per environment; those given then apply to the
    evaluation; in Python see `randomization`."""
    speed_error: Annotated[float, Range(0.0, 1.0, open_high=True)] = 0.02
    """With --randomize: largest error of the executed speed, as a share of it, unknown to the filter. On a slippery floor
    wheels lose a tenth."""
    turn_error: Annotated[float, Range(0.0, 1.0, open_high=True)] = 0.0
    """With --randomize: largest further error of the executed turning rate, as a share of it, such as that of a wrong track."""
    veer: Annotated[float, NON_NEGATIVE] = 0.0
    """With --randomize: largest turn per metre driven, rad/m, such as that of unequal wheels."""
    steps: Annotated[int | None, STEPS] = None
    """Environment steps; by default n_timesteps of the hyper-parameters. With few, the package's own hyper-parameters have
    fewer environments and smaller batches, see `hyperparameters.for_steps`."""
    config: Path | Mapping[str, Any] | None = None
    """Hyper-parameters, YAML in the form of rl-baselines3-zoo; by default those shipped with the package; in Python also a
    mapping."""
    overrides: Mapping[str, Any] = field(default_factory=dict)
    """Hyper-parameters that replace those of ``config``, by name: ``{"learning_rate": 3e-4, "policy_kwargs": {"net_arch": [32,
    32]}}``."""
    evaluations: Annotated[int, STEPS] = 5
    """Number of evaluations during training."""
    episodes: Annotated[int, Range(1, 1_000_000, whole=True)] = 500
    """Episodes of the evaluation at the end; those during training have the first 100."""
    device: str = "cpu"
    """Device of the network: cpu, cuda, or auto, which uses a GPU if there is one."""
    threads: Annotated[int, Range(1, 4096, whole=True)] = 1
    """Threads of torch and of the compiled loop; small networks gain nothing from more."""
    hyper: Mapping[str, Any] = field(init=False, repr=False)
    """The hyper-parameters, which ``config`` names; Stable-Baselines3 checks them when the training makes its model."""

    def __post_init__(self) -> None:
        check_fields(self, "")
        choose("device", self.device, dict.fromkeys(("cpu", "cuda", "auto")))
        object.__setattr__(self, "env", require_env(self.env))
        choose("algo", self.algo, dict.fromkeys(NAMES))
        object.__setattr__(self, "hyper", self._hyperparameters())

    def _hyperparameters(self) -> dict[str, Any]:
        """Return the hyper-parameters that ``config``, ``steps`` and ``overrides`` stand for."""
        if not (isinstance(self.overrides, Mapping) and all(isinstance(name, str) for name in self.overrides)):
            raise refusal("overrides", "hyper-parameters by name, such as {'learning_rate': 3e-4}", self.overrides)
        if "n_timesteps" in self.overrides:
            raise ValueError("n_timesteps is the option steps: use that.")
        hyper = hyperparameters.load(self.algo, self.env, self.config)
        hyper = hyperparameters.override(hyper, self.overrides)
        Range(1, 10**12, whole=True).check("n_envs", hyper["n_envs"])
        if self.config is None and self.steps is not None and "n_envs" not in self.overrides:
            hyper = hyperparameters.override(hyperparameters.for_steps(hyper, self.steps), self.overrides)
        return hyper

    @property
    def options(self) -> dict[str, Any]:
        """Return the arguments of the environments that differ from their defaults."""
        return Options(**{item.name: getattr(self, item.name) for item in fields(Options)}).changed()

    @property
    def total(self) -> int:
        return self.steps or self.hyper["n_timesteps"]

    def make(self, num_envs: int, **more: Any) -> VectorEnv:
        """Return environments to evaluate in, with more arguments."""
        modes = {"vectorization_mode": "vector_entry_point", "autoreset_mode": AutoresetMode.SAME_STEP}
        return gym.make_vec(self.env, num_envs=num_envs, **modes, **arguments_of(self.options), **more)

    def make_judging(self) -> VectorEnv:
        """Return environments that drive the episodes of an evaluation in turn."""
        return self.make(min(self.episodes, ROWS))

    def make_training(self) -> VectorEnv:
        """Return environments to train in, randomized if configured."""
        envs = self.make(self.hyper["n_envs"], info="rewards")
        if self.randomize:
            bare: Any = envs.unwrapped
            errors = {name: getattr(self, name) for name in RANDOMIZED}
            bare.set_parameters(randomized(bare.parameters, envs.num_envs, seed=self.seed, **errors))
        return envs

    def settings(self) -> dict[str, Any]:
        """Return the fields as JSON types, without the hyper-parameters."""
        settings = {name: value for name, value in asdict(self).items() if name != "hyper"}
        as_given = {name: getattr(self, name) for name in ("filter", "observation", "reward")}  # by name, not by their fields
        return plain(settings | as_given | ({"config": None} if isinstance(self.config, Mapping) else {}))

    def record(self) -> dict[str, Any]:
        """Return the content of a run's config.json: settings, hyper-parameters and provenance."""
        return {"config": self.settings(), "hyperparameters": dict(self.hyper), **provenance()}


def require_env(env: str) -> str:
    """Return the id of an environment that is given by it or by its short name, and is registered."""
    env = environment_id(env)
    if not isinstance(env, str) or env not in registry:
        ids = [spec.id for spec in registry.values() if spec.namespace == "turtlebot_gym"]
        error = refusal("env", f"one of {', '.join(map(repr, ids))}, or another id with their arguments", env)
        raise ValueError(f"{error}{did_you_mean(env, ids)}")
    return env


def require_no_run(folder: Path) -> None:
    """Raise ValueError if a folder holds a run."""
    if (folder / "config.json").exists():
        raise ValueError(f"{folder} holds a run already: choose another folder, or replace it by --force (force=True).")


def forget_run(folder: Path) -> None:
    """Remove configuration and curves of a run, if a folder holds one; a new run replaces the other files."""
    (folder / "config.json").unlink(missing_ok=True)
    rmtree(folder / "tensorboard", ignore_errors=True)
