"""The algorithms of Stable-Baselines3 by their names in lower case."""

from __future__ import annotations

import stable_baselines3
from stable_baselines3.common.base_class import BaseAlgorithm

ALGORITHMS: dict[str, type[BaseAlgorithm]] = {
    name.lower(): getattr(stable_baselines3, name) for name in ("A2C", "DDPG", "PPO", "SAC", "TD3")
}
"""What `training.train.train` takes for ``algo``."""
