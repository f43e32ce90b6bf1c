"""Models of Stable-Baselines3, made for the configuration of a training."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import stable_baselines3
import torch
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm

from turtlebot_gym.observations import OPEN_GROUND, ObservationTerm
from turtlebot_gym_agents.policies import Policy, make_policy
from turtlebot_gym_agents.policies.fit import parameters_of
from turtlebot_gym_agents.policies.policy import shown
from turtlebot_gym_agents.training.config import NAMES, TrainingConfig
from turtlebot_gym_agents.training.hyperparameters import arguments
from turtlebot_gym_agents.training.normalization import NormalizedObservation, measure, ranges_in
from turtlebot_gym_agents.training.sb3_vec_env import Sb3VecEnv, Staggered

ALGORITHMS: dict[str, type[BaseAlgorithm]] = {name: getattr(stable_baselines3, name.upper()) for name in NAMES}
"""The algorithms of Stable-Baselines3 by their names in lower case."""
MEASURED = 76_800
"""Most steps of all environments together from which the observations' normalization is measured."""
STAGGER = 300
"""Steps within which the environments of a training begin."""
NORMALIZATION_SEED = 2**41
TRAINING_SEED = 2**42
"""A run's environments have seeds from (1 + its seed) times this, separate from others."""


def _stands(observations: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.zeros((len(observations), 2), np.float32)


def make_model(config: TrainingConfig, envs: VectorEnv, *, tensorboard: Path | None = None) -> BaseAlgorithm:
    """Return a new model for environments, which logs to the folder ``tensorboard``; refuse what Stable-Baselines3 refuses."""
    parameters = parameters_of(envs)
    terms: tuple[ObservationTerm, ...] = envs.unwrapped.observation_terms  # pyright: ignore[reportAttributeAccessIssue]
    ranges = ranges_in(terms)
    driver: Policy = _stands
    if {term.name for term in OPEN_GROUND} <= {term.name for term in terms}:  # otherwise it cannot steer, and stands
        driver = shown(make_policy("bearing", robot=parameters.robot, dt=parameters.dt), "bearing", terms)
    steps = min(300, max(1, MEASURED // envs.num_envs))
    mean, std = measure(envs, driver, ranges, seed=NORMALIZATION_SEED + config.seed, steps=steps)
    layer = {"mean": mean, "std": std, "ranges": ranges}
    normalization = {"features_extractor_class": NormalizedObservation, "features_extractor_kwargs": layer}
    if config.device == "cuda" and not torch.cuda.is_available():
        raise ValueError(f"device 'cuda' is not available: torch {torch.__version__} finds no GPU; use --device cpu.")
    keywords = arguments(config.hyper)
    adapter = Sb3VecEnv(Staggered(envs, driver, STAGGER), reward_scale=config.hyper.get("reward_scale", 1.0))
    try:
        model = ALGORITHMS[config.algo](
            config.hyper["policy"],
            adapter,
            seed=config.seed,
            device=config.device,
            tensorboard_log=None if tensorboard is None else str(tensorboard),
            **{**keywords, "policy_kwargs": normalization | keywords["policy_kwargs"]},
        )
    except (TypeError, ValueError, AssertionError) as error:
        reason = " ".join(str(error).split())
        raise ValueError(f"Stable-Baselines3 refuses the hyper-parameters of {config.algo}, see --config: {reason}") from error
    adapter.seed((1 + config.seed) * TRAINING_SEED)  # making the model has set the model's own seed there
    return model
