"""Times of a training: its CPU seconds by phase, and a limit of its wall time."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from stable_baselines3.common.callbacks import BaseCallback


class Stopwatch:
    """Charge the CPU seconds of all threads to the phase that runs; a phase within another is charged alone."""

    def __init__(self) -> None:
        self._spent: defaultdict[str, float] = defaultdict(float)
        self._phase, self._mark = "setup", time.process_time()

    def switch(self, phase: str) -> str:
        """Begin a phase, and return the one that ends."""
        now, ended = time.process_time(), self._phase
        self._spent[ended] += now - self._mark
        self._phase, self._mark = phase, now
        return ended

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Charge this block to a phase."""
        around = self.switch(name)
        try:
            yield
        finally:
            self.switch(around)

    def seconds(self) -> dict[str, float]:
        """Return the CPU seconds of each phase until now."""
        self.switch(self._phase)
        return {name: round(spent, 4) for name, spent in self._spent.items()}


class StopwatchCallback(BaseCallback):
    """Tell a stopwatch when rollouts and updates begin; the first one of the callbacks."""

    def __init__(self, watch: Stopwatch) -> None:
        super().__init__()
        self._watch = watch

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        self._watch.switch("rollouts")

    def _on_rollout_end(self) -> None:
        self._watch.switch("updates")

    def _on_training_end(self) -> None:
        self._watch.switch("files")


class _InTime:
    """A schedule by progress that also ends when the time is up.

    Args:
        schedule: A value by the share of the training that remains.
        begun: When the time begins, by `time.monotonic`, s.
        seconds: How long it lasts.
    """

    def __init__(self, schedule: Callable[[float], float], begun: float, seconds: float) -> None:
        self._schedule, self._begun, self._seconds = schedule, begun, seconds

    def __call__(self, remaining: float) -> float:
        return self._schedule(min(remaining, max(0.0, 1.0 - (time.monotonic() - self._begun) / self._seconds)))


class TimeLimitCallback(BaseCallback):
    """Stop a training after a wall time, by which its schedules end.

    Args:
        seconds: Wall time from the first rollout on, s.
    """

    def __init__(self, seconds: float) -> None:
        super().__init__()
        self._seconds = seconds
        self.stopped = False
        """Whether the time has ended the training."""

    def _on_training_start(self) -> None:
        self._begun, model = time.monotonic(), self.model
        for name in ("lr_schedule", "clip_range", "clip_range_vf"):
            schedule: Any = getattr(model, name, None)
            if schedule is not None:
                setattr(model, name, _InTime(schedule, self._begun, self._seconds))

    def _on_step(self) -> bool:
        self.stopped = time.monotonic() - self._begun >= self._seconds
        return not self.stopped
