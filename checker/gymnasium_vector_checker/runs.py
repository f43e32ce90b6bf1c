"""Step a vector environment, and record what happens to each row in a form that is the same in every mode."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from copy import deepcopy
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from gymnasium.error import Error
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import concatenate, create_empty_array, iterate
from numpy.typing import NDArray

NEXT_STEP, SAME_STEP, DISABLED = AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP, AutoresetMode.DISABLED
FINAL = ("final_obs", "final_info")
"""Keys under which SAME_STEP reports an ended episode."""
LIMIT = 7
"""Steps per episode if the environment takes ``max_episode_steps``, so that ends come soon and at known times."""


class Event(NamedTuple):
    """What happened to one environment: the first observation of an episode, or a step."""

    kind: str
    observation: Any
    reward: float
    terminated: bool
    truncated: bool
    info: dict[str, Any]


@dataclass(frozen=True)
class Case:
    """An environment in one mode, and how to step it."""

    make: Callable[..., VectorEnv]
    mode: AutoresetMode
    num_envs: int
    steps: int
    limit: int | None

    def supported(self) -> bool:
        """Return whether the environment can be made in this mode."""
        try:
            self.open().close()
        except (TypeError, ValueError, NotImplementedError, Error):
            return False
        return True

    def open(self, num_envs: int | None = None) -> VectorEnv:
        """Make the environment."""
        limit = {} if self.limit is None else {"max_episode_steps": self.limit}
        return self.make(num_envs=num_envs or self.num_envs, autoreset_mode=self.mode, **limit)

    def play(self, seed: Any, *, rows: Iterable[int] | None = None, **options: Any) -> list[list[Event]]:
        """Return what happens to each row of a new environment; see `Run`."""
        indices = list(range(self.num_envs) if rows is None else rows)
        with closing(self.open(len(indices))) as env:
            run = Run(self, env, indices, **options)
            run.reset(seed)
            for _ in range(self.steps):
                run.step()
            return run.events


class Run:
    """Steps an environment, and records what happens to each row in a form that is the same in every mode.

    Each row takes an action from its own queue only when it uses one; actions that must be ignored are junk. Row 0 is
    reset alone after its third step, so that the rows' episodes end at different times.

    Args:
        case: The environment's mode and how to make it.
        env: The environment.
        rows: Which queue of actions each row takes; None for the queue of its own number.
        stagger: Whether row 0 is reset alone.
        junk: Seed of the actions that must be ignored.
        scribble: Whether to overwrite everything that the environment returns.
    """

    def __init__(
        self,
        case: Case,
        env: VectorEnv,
        rows: list[int] | None = None,
        *,
        stagger: bool = True,
        junk: int = 0,
        scribble: bool = False,
    ) -> None:
        rows = list(range(env.num_envs)) if rows is None else rows
        self.case, self.env, self.scribble = case, env, scribble
        self.queues = [actions_of(env, 100 + row) for row in rows]
        self.junk = actions_of(env, 10_000 + junk)
        self.taken = 0 if stagger and rows[0] == 0 else 99
        self.ended = np.zeros(env.num_envs, np.bool_)
        self.events: list[list[Event]] = [[] for _ in rows]

    def reset(self, seed: Any = None, mask: NDArray[np.bool_] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset the rows in the mask, or all."""
        which = np.ones(self.env.num_envs, np.bool_) if mask is None else mask
        returned = self.env.reset(seed=seed, options=None if mask is None else {"reset_mask": mask.copy()})
        self._note("reset", which, *returned)
        self.ended = self.ended & ~which
        return self._give(returned)

    def step(self) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Step, reset ended episodes where the mode leaves that to the caller, and return what the step returned."""
        ignored = self.ended & (self.case.mode is NEXT_STEP)
        actions = [self.junk.sample() if ignored[i] else queue.sample() for i, queue in enumerate(self.queues)]
        returned = self.env.step(together(self.env, actions))
        observations, rewards, terminated, truncated, infos = returned
        done = self.ended = np.logical_or(terminated, truncated)
        if self.case.mode is SAME_STEP and done.any():
            last = [final if done[i] else row for i, (final, row) in enumerate(zip(*_pair(self.env, returned), strict=True))]
            self._note("step", done, last, infos["final_info"], rewards, terminated, truncated)
            self._note("step", ~done, observations, infos, rewards, terminated, truncated)
            self._note("reset", done, observations, infos)
        else:
            self._note("reset", ignored, observations, infos)
            self._note("step", ~ignored, observations, infos, rewards, terminated, truncated)
        returned = self._give(deepcopy(returned) if not self.scribble else returned)
        if self.case.mode is DISABLED and done.any():
            self.reset(mask=done.copy())
        self.taken += not ignored[0]
        if self.taken == 3 and not ignored[0] and not done[0]:
            self.reset(mask=np.arange(self.env.num_envs) == 0)
        return returned

    def _note(self, kind: str, mask: Any, observations: Any, infos: Any, rewards: Any = None, *ends: Any) -> None:
        rows = observations if isinstance(observations, list) else rows_of(self.env, observations)
        for i in np.flatnonzero(mask):
            reward = 0.0 if rewards is None else float(rewards[i])
            terminated, truncated = (bool(end[i]) for end in ends) if ends else (False, False)
            info = _info_row(infos, int(i))
            self.events[i].append(Event(kind, deepcopy(rows[i]), reward, terminated, truncated, info))

    def _give(self, returned: Any) -> Any:
        if self.scribble:
            for array in _arrays(returned):
                array[...] = 1 if array.dtype == np.bool_ else 0
        return returned


def actions_of(env: VectorEnv, seed: int) -> Any:
    """Return an action space to sample from, with its own random numbers."""
    space = deepcopy(env.single_action_space)
    space.seed(seed)
    return space


def together(env: VectorEnv, rows: list[Any]) -> Any:
    """Return the batch of single actions."""
    return concatenate(env.single_action_space, rows, create_empty_array(env.single_action_space, len(rows)))


def rows_of(env: VectorEnv, observations: Any) -> list[Any]:
    """Return the single observations of a batch."""
    return list(iterate(env.observation_space, observations))


def _pair(env: VectorEnv, returned: Any) -> tuple[Any, list[Any]]:
    """Return the final observations (of ended rows) and the current ones."""
    final = returned[4]["final_obs"]
    return final if isinstance(final, np.ndarray) else rows_of(env, final), rows_of(env, returned[0])


def _info_row(infos: dict[str, Any], i: int) -> dict[str, Any]:
    row = {}
    for key, value in infos.items():
        if not key.startswith("_") and key not in FINAL and infos[f"_{key}"][i]:
            row[key] = _info_row(value, i) if isinstance(value, dict) else deepcopy(value[i])
    return row


def _arrays(value: Any) -> Iterator[NDArray[Any]]:
    """Yield the arrays of numbers in what an environment returns."""
    if isinstance(value, np.ndarray) and value.dtype != object:
        if value.flags.writeable:
            yield value
    elif isinstance(value, (tuple, list, dict, np.ndarray)):
        for item in value.values() if isinstance(value, dict) else value:
            yield from _arrays(item)


def difference(expected: list[list[Event]], seen: list[list[Event]], rows: Iterable[int] | None = None) -> str | None:
    """Say where two records of the same rows first differ, up to the end of the shorter one."""
    for i in range(len(seen)) if rows is None else rows:
        for at, (event, other) in enumerate(zip(expected[i], seen[i], strict=False)):
            for name, a, b in zip(Event._fields, event, other, strict=True):
                if not data_equivalence(a, b, exact=True):
                    return f"environment {i}, event {at} ({event.kind}): {name} {b!r} instead of {a!r}."
    return None
