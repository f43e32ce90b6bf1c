"""Callbacks for training with Stable-Baselines3: progress, evaluation on separate seeds, and the files of a run.

They do not depend on the command line: scripts can pass them to ``model.learn(callback=[...])``.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.distributions import DiagGaussianDistribution
from stable_baselines3.common.policies import ActorCriticPolicy

from turtlebot_gym import Parameters
from turtlebot_gym_agents.policies import Policy
from turtlebot_gym_agents.policies.fit import parameters_of
from turtlebot_gym_agents.provenance import replace_json
from turtlebot_gym_agents.training.config import TrainingConfig
from turtlebot_gym_agents.training.export import export
from turtlebot_gym_agents.training.judging import Judged, judge
from turtlebot_gym_agents.training.model import save_model, weights_of
from turtlebot_gym_agents.training.sb3_vec_env import Sb3VecEnv

EVALUATION_SEED = 2**40
"""First seed of the evaluation's episodes, far from typical user seeds and those of trainings."""
INTERIM = 100
"""Most episodes of an evaluation before the end of a training."""
CHECKED = 100
"""Steps in which a training's bundle is compared with its model."""


def mean_actions(policy: ActorCriticPolicy, observations: torch.Tensor) -> torch.Tensor:
    """Return the means of a Gaussian policy's actions."""
    features = policy.pi_features_extractor(observations)
    return policy.action_net(policy.mlp_extractor.forward_actor(features))


def policy_of(model: BaseAlgorithm) -> Policy:
    """Return a model's deterministic policy: ``model.predict`` to the bit, in half the time."""
    policy: Any = model.policy
    inputs, outputs = model.observation_space, model.action_space
    gaussian = type(policy) is ActorCriticPolicy and type(policy.action_dist) is DiagGaussianDistribution
    if not gaussian or not isinstance(outputs, spaces.Box) or not isinstance(inputs, spaces.Box) or len(inputs.shape) != 1:
        return lambda observations: model.predict(observations, deterministic=True)[0]
    policy.set_training_mode(False)
    device = policy.device

    def act(observations: NDArray[np.float32]) -> NDArray[np.float32]:
        with torch.no_grad():
            mean = mean_actions(policy, torch.as_tensor(observations, device=device).float())
        return np.clip(mean.cpu().numpy(), outputs.low, outputs.high)

    return act


class Callback(BaseCallback):
    """A callback that acts between rollouts and never stops a training."""

    def _on_step(self) -> bool:
        return True


class EvaluationCallback(BaseCallback):
    """Evaluate the deterministic policy on separate seeds, during training and at its end; keep the best model, and log.

    An evaluation during training drives the first `INTERIM` of the seeds, one at its end all of them.

    Args:
        envs: Vector environment in the mode SAME_STEP, not the training's.
        every: Steps between evaluations.
        episodes: Number of seeds; None for as many as environments.
        path: File of the model with the highest mean return; None to keep none.
        seed: First seed of the evaluation.
        go_on: Called with the figures; the training stops if it returns false.
        confirm: Whether it stops only if ``go_on`` also returns false for the figures of all seeds.
    """

    def __init__(
        self,
        envs: VectorEnv,
        *,
        every: int,
        episodes: int | None = None,
        path: Path | None = None,
        seed: int = EVALUATION_SEED,
        go_on: Callable[[dict[str, float]], bool] = lambda figures: True,
        confirm: bool = False,
    ) -> None:
        super().__init__()
        self._confirm = confirm
        self._envs, self._every, self._path, self._seed, self._go_on = envs, every, path, seed, go_on
        self._episodes = envs.num_envs if episodes is None else episodes
        self._next, self._most = every, -np.inf
        self.stopped = False
        """Whether `go_on` has ended the training."""
        self.best: dict[str, float] = {"return": -np.inf}
        """Figures of the best model, with its number of training steps."""
        self.history: list[dict[str, float]] = []
        """Figures of all evaluations."""

    def _on_training_start(self) -> None:
        self._next = self.num_timesteps + self._every

    def _on_step(self) -> bool:
        return not self.stopped

    def _on_rollout_start(self) -> None:
        if self.num_timesteps >= self._next:
            self._next = self.num_timesteps + self._every
            self.run(INTERIM)
            if self.stopped and self._confirm:
                self.run(self._episodes)

    def _on_training_end(self) -> None:
        if not self.stopped:
            self.run(self._episodes)
        self.logger.dump(self.num_timesteps)

    @property
    def parameters(self) -> Parameters:
        return parameters_of(self._envs)

    def run(self, episodes: int) -> dict[str, float]:
        """Evaluate the model in at most so many episodes, and return the figures."""
        judged = self._judge(episodes)
        reached = self._figures(judged)
        self.history = [*(row for row in self.history if row["steps"] < reached["steps"]), reached]
        for name, value in reached.items():
            self.logger.record(f"eval/{name}", value)
        self._keep_best(judged, reached)
        self.stopped = not self._go_on(reached)
        return reached

    def _keep_best(self, judged: Judged, reached: dict[str, float]) -> None:
        """Keep the model if it is the best; of an evaluation with more episodes than `INTERIM`, the best so far drives all."""
        mean = float(judged.returns[:INTERIM].mean())
        if mean <= self._most and len(judged.returns) > INTERIM and self._path is not None:
            with weights_of(self.model, self._path):
                self.best = self._figures(self._judge(len(judged.returns)))
            is_best = reached["return"] > self.best["return"]
        else:
            is_best = mean > self._most
        if is_best:
            self.best, self._most = reached, mean
            if self._path is not None:
                save_model(self.model, self._path)

    def _judge(self, episodes: int) -> Judged:
        return judge(self._envs, policy_of(self.model), seed=self._seed, episodes=min(episodes, self._episodes))

    def _figures(self, judged: Judged) -> dict[str, float]:
        return {"steps": float(self.model.num_timesteps), **judged.figures()}


class RecordCallback(Callback):
    """Write what a run depends on into its folder when it begins, and the bundle of its best model when it ends.

    Args:
        config: Configuration of the training.
        folder: Folder of the run; the best model is in its ``best.zip``.
        judge: The evaluation, an earlier one of the callbacks: it determines the best model.
    """

    def __init__(self, config: TrainingConfig, folder: Path, judge: EvaluationCallback) -> None:
        super().__init__()
        self._config, self._folder, self._judge = config, folder, judge
        self._begun = time.monotonic()

    def _on_training_start(self) -> None:
        self._record = {**self._config.record(), "device": self.model.device.type}
        self._folder.mkdir(parents=True, exist_ok=True)
        replace_json(self._folder / "config.json", self._record)

    def _on_training_end(self) -> None:
        seconds = round(time.monotonic() - self._begun, 1)
        about = {**self._record, "steps": self.num_timesteps, "seconds": seconds, "evaluation": self._judge.best}
        with weights_of(self.model, self._folder / "best.zip"):
            card = self._config.card(self._judge.parameters, about)
            options = {"vec_normalize": "none", "card": card, "steps": CHECKED, **self._config.options}
            export(self.model, self._folder / "policy.onnx", env=self._config.env, **options)


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


class ProgressCallback(BaseCallback):
    """Show a bar on standard error, with the success rate of the last 200 episodes.

    Args:
        total: Steps of the whole training.
        label: Text before the bar.
    """

    def __init__(self, total: int, *, label: str = "training") -> None:
        super().__init__()
        self._total, self._label = total, label
        self._success: deque[bool] = deque(maxlen=200)
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.completed:,.0f}/{task.total:,.0f} steps, {task.fields[rate]:,.0f}/s, {task.fields[success]}"),
            TimeRemainingColumn(),
            console=Console(stderr=True),
        )

    def _on_training_start(self) -> None:
        self._start = time.monotonic(), self.num_timesteps
        self._progress.start()
        self._task = self._progress.add_task(
            self._label, total=self._total, completed=self.num_timesteps, rate=0.0, success="no episode yet"
        )

    def _on_step(self) -> bool:
        dones: Any = self.locals.get("dones")
        if dones is not None and dones.any():
            self._success.extend(bool(self.locals["infos"][row].get("is_success")) for row in np.flatnonzero(dones))
        return True

    def _on_rollout_end(self) -> None:
        begun, first = self._start
        rate = (self.num_timesteps - first) / max(time.monotonic() - begun, 1e-9)
        success = f"success {np.mean(self._success):.0%}" if self._success else "no episode yet"
        self._progress.update(self._task, completed=self.num_timesteps, rate=rate, success=success)

    def _on_training_end(self) -> None:
        self.stop()

    def stop(self) -> None:
        """Release the terminal after an exception, about which SB3 does not notify callbacks."""
        self._progress.stop()
