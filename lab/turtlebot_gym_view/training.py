"""Show the current policy in a browser while it learns."""

from __future__ import annotations

import time

from turtlebot_gym.drive import Drive
from turtlebot_gym_agents.training.callbacks import EVALUATION_SEED, Callback, policy_of
from turtlebot_gym_agents.training.config import TrainingConfig
from turtlebot_gym_view import record_episode
from turtlebot_gym_view.buffer import DriveBuffer
from turtlebot_gym_view.server import Server


class WatchCallback(Callback):
    """Drive the same episode with the current policy at intervals, and serve the newest drive to browsers.

    Args:
        config: Configuration of the training.
        seconds: Least time between two episodes, see `Callback`.
        port: Port on this machine; 0 for any free port.
    """

    def __init__(self, config: TrainingConfig, *, seconds: float = 5.0, port: int = 5006) -> None:
        super().__init__(seconds=seconds)
        self._config, self._port = config, port
        self.server: Server | None = None
        """Server of the view during training."""

    def _on_training_start(self) -> None:
        self.drive = DriveBuffer(self._record())
        self.server = Server([self.drive], title=self._config.title, live=True, port=self._port)
        self.server.__enter__()
        print(f"{self.server.url} shows the current policy", flush=True)

    def _record(self) -> Drive:
        begun = time.monotonic()
        label = f"after {self.num_timesteps:,} steps"
        config = self._config
        drive = record_episode(policy_of(self.model), env=config.env, seed=EVALUATION_SEED, label=label, **config.options)
        self._wait_after(begun)
        return drive

    def _on_rollout_start(self) -> None:
        if time.monotonic() >= self._due:
            self.drive.restart(self._record())

    def _on_training_end(self) -> None:
        if self.server is not None:
            self.server.__exit__(None, None, None)
            self.server = None
