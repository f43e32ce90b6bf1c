"""The native vector environment: many TurtleBots in one compiled loop."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.error import Error, InvalidAction, ResetNeeded
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.compiled.loop import FLAGS
from turtlebot_gym.config import choose, refusal
from turtlebot_gym.envs import common
from turtlebot_gym.envs.rendering import Pictures
from turtlebot_gym.envs.vector import SeededVectorEnv
from turtlebot_gym.rooms.geodesic import UNKNOWN
from turtlebot_gym.rooms.scene import Scene
from turtlebot_gym.rooms.worlds import no_way
from turtlebot_gym.systems import Outcome, Parameters, Snapshot

_REWARD, _DISTANCE, _SUCCESS = map(Outcome._fields.index, ("reward", "distance", "is_success"))
_NUMBERS = {"nis": "estimate.nis", "measured": "senses.odometry.measured", "slipping": "body.slipping"}
"""Single numbers of ``info="full"``: the normalized innovation squared of the last measurement, which the policy sees clipped;
whether a measurement arrived; and whether the wheels slip."""
DRAWN = 9
"""Most environments that are drawn."""
_FEW = 8192  # a BLAS shares the work on longer arrays among threads, which a step must not wake


class NavigationVectorEnv(SeededVectorEnv):
    """Many `NavigationEnv`s at once; row *i* has the trajectory of the scalar environment with seed ``seed + i``.

    Observations, actions, rewards and episode ends are those of `NavigationEnv`, stacked. `reset` and `step` return new
    arrays each time.

    ``info`` holds ``distance`` and ``is_success``, shape (N,), and with ``info="full"`` also ``true_state`` (N, 5),
    ``odometry`` (N, 3), ``estimate`` (N, 5), ``covariance`` (N, 3, 3), ``reference`` (N, 3), ``command`` (N, 2), and ``nis``,
    ``measured`` and ``slipping``, shape (N,), and ``reward_shares`` (N, k), what each of the `reward_terms` adds to the reward.
    Each key has a mask, as Gymnasium requires, which is false for environments that a reset left out; the keys of a step share
    one, which cannot be written to. In the mode SAME_STEP, ``final_obs`` (an array of objects, as in `SyncVectorEnv`: an
    observation, or None where no episode ended) and ``final_info`` hold the last observation and info of the finished episodes.

    In rooms, ``info`` always holds ``clearance``, ``path_length``, ``way_left`` and ``collision`` too, shape (N,).

    Args:
        num_envs: Number of environments.
        max_episode_steps: Steps after which an episode is truncated; None for the task's own. A `turtlebot_gym.Task` may have a
            lower limit.
        autoreset_mode: What happens after an episode's end, `gymnasium.vector.AutoresetMode` or its name: NEXT_STEP (the
            default; the next step ignores the action and returns the new episode's first observation with reward 0),
            SAME_STEP (the same step returns it), or DISABLED (stepping a finished environment is an error).
        info: "default"; "rewards", with what each term adds to the reward; or "full".
        render_mode: None or "rgb_array", for pictures of the first `DRAWN` environments.
        **options: See `NavigationEnv`, whose errors are raised, too.
    """

    def __init__(
        self,
        num_envs: int = 1,
        *,
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        info: str = "default",
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        super().__init__(num_envs, max_episode_steps, autoreset_mode, render_mode, options)
        self._tells_shares = choose("info", info, {"default": False, "rewards": True, "full": True})
        p, waypoints, plan, system = self._setup
        self._batch = Batch(self.num_envs, p, waypoints, system=system, plan=plan, shares=self._tells_shares)
        self.reward_terms = tuple(term.name for term in system.rewards)
        """Names of the terms of the reward, in the order of ``info["reward_shares"]``."""
        self._in_room = system.in_room
        parts = (common.ROOM_PARTS if self._in_room else {}) | (common.PARTS | _NUMBERS if info == "full" else {})
        self._told = {key: common.indices_of(self._batch, key, path) for key, path in parts.items()}
        self._batch.select(*self._told.values())
        self._tells_little = not parts and not self._tells_shares
        self._pictures = Pictures(self._batch, render_mode, rows=min(DRAWN, self.num_envs))
        self._done = np.zeros(self.num_envs, np.bool_)
        self._is_any_over = False
        self._everywhere = np.ones(self.num_envs, np.bool_)  # the mask of each key in each step, so nobody may write to it
        self._everywhere.flags.writeable = False

    @property
    def parameters(self) -> Parameters | Sequence[Parameters]:
        """Everything that the environments' transitions depend on: one for all environments, or one for each."""
        return self._batch.parameters

    def set_parameters(self, parameters: Parameters | Sequence[Parameters]) -> None:
        """Use other parameters from the next step on: one for all environments, or one for each."""
        self._batch.set_parameters(parameters)
        self._pictures.begin(self._everywhere)  # they show the old robots and rooms

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start episodes.

        Args:
            seed: An int gives environment *i* the seed ``seed + i``; a list has one seed for each; None, also in the
                list, begins the next episode of the seed in use.
            options: ``reset_mask``, boolean, shape (N,): reset only these. The others keep their state and have no infos.

        Raises:
            ValueError: If a seed or an option is invalid, or no path leads from start to goal.
            ResetNeeded: If the mask leaves out an environment that was never reset and so has no observation.
        """
        mask, batch = self._reset_mask(options), self._batch
        is_seeded, seeds = self._seed(seed)
        is_seeded &= mask
        batch.episodes[is_seeded] = -1
        batch.seeds[is_seeded] = seeds[is_seeded]
        observations, outcomes = batch.last()
        self._begin(mask, observations, outcomes)
        self._begun = True
        self._done[mask] = False
        self._is_any_over = np.count_nonzero(self._done) > 0
        return observations, self._info(outcomes, outcomes[_SUCCESS] != 0.0, mask)

    def _reset_mask(self, options: dict[str, Any] | None) -> NDArray[np.bool_]:
        mask: Any = common.read_options(options, ["reset_mask"]).get("reset_mask", np.ones(self.num_envs, np.bool_))
        if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.shape != (self.num_envs,) or not mask.any():
            raise refusal("reset_mask", f"a boolean array of shape ({self.num_envs},) that is true somewhere", mask)
        self._require_begun(mask)
        return mask

    def step(  # pyright: ignore[reportIncompatibleMethodOverride]  # Gymnasium has one type for rewards and episode ends
        self, actions: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Advance all environments by one control interval.

        Args:
            actions: Shape (N, 2), shares of the speed and turning rate limits; values beyond 1 are clipped.

        Raises:
            InvalidAction: If the actions have another shape or one is not finite.
            ResetNeeded: If the environments were never reset.
            Error: In the mode DISABLED, if an environment's episode has ended and it was not reset.
        """
        batch, mode = self._batch, self.autoreset_mode
        values = common.read_actions(actions, (self.num_envs, 2))
        if not _is_finite(values):
            bad = int(np.flatnonzero(~np.isfinite(values).all(axis=1))[0])
            raise InvalidAction(f"Environment {bad}: an action must be finite, got {values[bad]}.")
        if not self._begun:
            raise ResetNeeded("Call reset() before step().")
        is_any_over = self._is_any_over
        if mode is AutoresetMode.DISABLED and is_any_over:
            raise Error(f"Environment {np.argmax(self._done)}: its episode has ended; reset it with {{'reset_mask': mask}}.")
        observations, outcomes = batch.step(values)
        if mode is AutoresetMode.NEXT_STEP and is_any_over:
            self._begin(self._done, observations, outcomes)
        # Most steps set no flag and need no look at the numbers; one comparison of three rows takes half the time of three.
        is_flagged = is_any_over or batch.flagged > 0
        flags = outcomes[FLAGS] != 0.0 if is_flagged else np.zeros((3, self.num_envs), np.bool_)
        rewards, is_success, terminated, truncated = outcomes[_REWARD], flags[0], flags[1], flags[2]
        if is_flagged:
            self._done = terminated | truncated
            self._is_any_over = np.count_nonzero(self._done) > 0  # in a tenth of the time of `any`
        if mode is not AutoresetMode.SAME_STEP or not self._is_any_over:
            return observations, rewards, terminated, truncated, self._info(outcomes, is_success)
        last = np.empty(self.num_envs, object)
        for row in np.flatnonzero(self._done).tolist():
            last[row] = observations[row].copy()
        final = {"final_obs": last, "_final_obs": self._done.copy()}
        final |= {"final_info": self._info(outcomes, is_success, self._done), "_final_info": self._done.copy()}
        rewards = rewards.copy()
        self._begin(self._done, observations, outcomes)
        return observations, rewards, terminated, truncated, self._info(outcomes, outcomes[_SUCCESS] != 0.0) | final

    def _begin(self, mask: NDArray[np.bool_], observations: NDArray[np.float32], outcomes: NDArray[np.float64]) -> None:
        """Begin the next episode of some environments, and overwrite their values."""
        self._batch.episodes[mask.nonzero()] += 1  # in half the time of the mask itself
        self._batch.reset(mask, observations, outcomes)
        if self._in_room and (lost := mask & (self._batch.numbers(common.ROOM_PARTS["way_left"]) == UNKNOWN)).any():
            # No step may follow an episode that did not begin.
            self._begun, row = False, int(np.argmax(lost))
            raise ValueError(f"Environment {row}: {no_way(self._batch.parameters_of(row).robot)}")
        self._pictures.begin(mask)

    def _info(
        self, outcomes: NDArray[np.float64], is_success: NDArray[np.bool_], mask: NDArray[np.bool_] | None = None
    ) -> dict[str, Any]:
        """Return infos of all environments; those outside a mask are zeros."""
        infos: dict[str, Any] = {"distance": outcomes[_DISTANCE], "is_success": is_success}
        if mask is None and self._tells_little:  # the usual case, in half the time
            return infos | {"_distance": self._everywhere, "_is_success": self._everywhere}
        numbers, end = self._batch.selected(), 0
        for key, indices in self._told.items():
            start, end = end, end + indices.size
            part = numbers[start:end].T.reshape(-1, *indices.shape)
            infos[key] = part != 0.0 if key in common.FLAGS else part
        if self._tells_shares:
            infos["reward_shares"] = outcomes[common.FIRST_SHARE :].T
        if mask is not None:
            for key in infos.keys() & {"distance", "reward_shares"}:
                infos[key] = infos[key].copy()
            for value in infos.values():
                value[~mask] = 0
        has_info = self._everywhere if mask is None else mask.copy()
        return infos | {f"_{key}": has_info for key in infos}

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Return a picture, (height, width, 3), of each of the first `DRAWN` environments, after a reset."""
        return self._pictures.render(self._begun)

    def snapshot(self, index: int) -> Snapshot:
        """Return the whole state of one environment, which holds more than its ``info``: also what the sensors say."""
        return self._batch.world(index)

    def truth(self) -> tuple[Scene, NDArray[np.float64], NDArray[np.float64]]:
        """Return the ground truth in rooms: the rooms, the true states (N, 5), and the goals' poses (N, 3)."""
        if not self._in_room:
            raise ValueError("truth is of rooms: there is none on open ground.")
        return self._batch.scenes, self._batch.numbers("body.true_state"), self._batch.numbers("course.reference")


def _is_finite(values: NDArray[np.float32]) -> bool:
    """Return whether all actions of an array are finite."""
    few = values.size <= _FEW and values.flags.c_contiguous
    flat = values.reshape(-1)
    # The sum of squares is finite only if all are, and takes a fifth of the time.
    return (few and math.isfinite(flat.dot(flat))) or bool(np.isfinite(values).all())
