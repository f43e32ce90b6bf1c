"""Callbacks for training with Stable-Baselines3: evaluation on separate seeds, and shares of the reward.

They do not depend on the command line: scripts can pass them to ``model.learn(callback=[...])``.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from copy import deepcopy
from pathlib import Path

import numpy as np
from gymnasium.vector import VectorEnv
from stable_baselines3.common.callbacks import BaseCallback

from turtlebot_gym.files import replacing
from turtlebot_gym_agents.evaluation.driving import Judged, judge
from turtlebot_gym_agents.policies import Policy
from turtlebot_gym_agents.training.sb3_vec_env import Sb3VecEnv

EVALUATION_SEED = 2**40
"""First seed of the evaluation's episodes, far from typical user seeds and those of trainings."""
INTERIM = 100
"""Most episodes of an evaluation before the end of a training."""


class EvaluationCallback(BaseCallback):
    """Evaluate the deterministic policy on separate seeds, during training and at its end; keep the best model, and log.

    An evaluation during training, after each ``every`` steps, drives the first `INTERIM` of the ``episodes`` seeds, one at its
    end all of them; by default, as many as environments. These reset by themselves, and are not the training's. The model with
    the highest mean return is written to ``path``.
    """

    def __init__(self, envs: VectorEnv, *, every: int, episodes: int | None = None, path: Path | None = None) -> None:
        super().__init__()
        self._envs, self._every, self._path = envs, every, path
        self._episodes = envs.num_envs if episodes is None else episodes
        self._next, self._most = every, -np.inf
        self.best: dict[str, float] = {"return": -np.inf}
        """Figures of the best model, with its number of training steps."""
        self.history: list[dict[str, float]] = []
        """Figures of all evaluations."""

    def _on_training_start(self) -> None:
        self._next = self.num_timesteps + self._every

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        if self.num_timesteps >= self._next:
            self._next = self.num_timesteps + self._every
            self._run(INTERIM)

    def _on_training_end(self) -> None:
        self._run(self._episodes)
        self.logger.dump(self.num_timesteps)

    def _run(self, episodes: int) -> None:
        """Evaluate the model in at most so many episodes."""
        judged, reached = self._judge(episodes)
        self.history.append(reached)
        for name, value in reached.items():
            self.logger.record(f"eval/{name}", value)
        mean = float(judged.returns[:INTERIM].mean())
        is_best = mean > self._most
        if not is_best and len(judged.returns) > INTERIM:  # then the best so far drives all of the seeds, too
            with self.best_model():
                _, self.best = self._judge(len(judged.returns))
            is_best = reached["return"] > self.best["return"]
        if is_best:
            self.best, self._most = reached, mean
            self._weights = deepcopy(self.model.policy.state_dict())
            if self._path is not None:
                with replacing(self._path) as beside, beside.open("wb") as file:
                    self.model.save(file)

    def _judge(self, episodes: int) -> tuple[Judged, dict[str, float]]:
        policy: Policy = lambda observations: self.model.predict(observations, deterministic=True)[0]  # noqa: E731
        judged = judge(self._envs, policy, seed=EVALUATION_SEED, episodes=min(episodes, self._episodes))
        return judged, {"steps": float(self.model.num_timesteps), **judged.figures()}

    @contextmanager
    def best_model(self) -> Iterator[None]:
        """Give the model the weights and the number of steps of the best one within this block."""
        state, steps = deepcopy(self.model.policy.state_dict()), self.model.num_timesteps
        self.model.policy.load_state_dict(self._weights)
        self.model.num_timesteps = int(self.best["steps"])
        try:
            yield
        finally:
            self.model.policy.load_state_dict(state)
            self.model.num_timesteps = steps


class RewardCallback(BaseCallback):
    """Record what each term adds to the reward of a step, on average since the last record, as ``reward/NAME``."""

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        self._begun = self.num_timesteps

    def _on_rollout_end(self) -> None:
        envs = self.training_env
        assert isinstance(envs, Sb3VecEnv)
        for name, total in zip(envs.get_attr("reward_terms")[0] if envs.shares.size else (), envs.shares, strict=True):
            self.logger.record(f"reward/{name}", total / max(self.num_timesteps - self._begun, 1))
        envs.shares = np.zeros(0)
