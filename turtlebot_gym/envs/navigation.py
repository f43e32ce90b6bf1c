"""The scalar environment: one TurtleBot that navigates on its filter's estimate."""

from __future__ import annotations

import math
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.error import InvalidAction, ResetNeeded
from numpy.typing import NDArray

from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.config import as_int, choose, refusal
from turtlebot_gym.envs import common
from turtlebot_gym.envs.rendering import Pictures
from turtlebot_gym.models.random import MAX_SEED
from turtlebot_gym.rooms.geodesic import UNKNOWN
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.rooms.rules import RoomRules
from turtlebot_gym.rooms.worlds import no_way, with_options
from turtlebot_gym.systems import Options, Parameters, Snapshot, make_room
from turtlebot_gym.tasks import given_pose

_POSES = ("start", "goal")
"""Options of a reset that are poses."""


class NavigationEnv(gym.Env[NDArray[np.float32], NDArray[np.float32]]):
    """A differential-drive robot that navigates on the estimate of a Kalman filter, on open ground or in rooms.

    ## Description

    A unicycle executes velocity commands with slip and process noise; its odometry is noisy, spiky, biased or drifting;
    a Kalman filter estimates its state. The policy sees the filter's estimate and drives to a goal.

    In rooms there are walls and obstacles, which differ from episode to episode; a path to the goal always exists. The robot
    knows its goal only in the frame of its odometry, and the room only through a LiDAR that turns as the robot drives.

    ## Action Space

    ``Box(-1, 1, (2,), float32)``: forward speed and turning rate as shares of the robot's limits. Values beyond 1 are
    clipped. The command is then scaled into the limits per axis and per wheel, which keeps the curvature of the path.

    ## Observation Space

    A tuple of named terms, which the option ``observation`` changes and adds to, see `turtlebot_gym.observations`: ``Box((13,),
    float32)`` on open ground, ``Box((50,), float32)`` in rooms, and ``Box((54,), float32)`` with a localizer and
    ``observation="located"``, with finite bounds, to which observations are clipped. What follows from a pose follows from the
    estimated one (with ``observation="odometry"`` from the measured one, with ``"truth"`` from the true one).

    | Term | # | Observation | Unit | Min | Max |
    |---|---|---|---|---|---|
    | goal | 0 | distance to the waypoint | m | 0 | 20 |
    | goal | 1, 2 | cosine and sine of its bearing in the body frame; (1, 0) at distance 0 | | -1 | 1 |
    | goal | 3, 4 | cosine and sine of the heading still to turn | | -1 | 1 |
    | twist | 5 | speed / limit | | -2 | 2 |
    | twist | 6 | turning rate / limit | | -2 | 2 |
    | uncertainty | 7 | stated standard deviation of the position (of the odometry; 0 for the truth) | m | 0 | 5 |
    | uncertainty | 8 | stated standard deviation of the heading | rad | 0 | pi |
    | uncertainty | 9 | normalized innovation squared of the last measurement | | 0 | 25 |
    | next_goal | 10 | distance to the waypoint after this one; to this one again if there is none | m | 0 | 20 |
    | next_goal | 11, 12 | cosine and sine of its bearing | | -1 | 1 |
    | evidence | | if located: stated standard deviation of the position ahead, and aside of the believed heading | m | 0 | 5 |
    | evidence | | if located: share of the last scan's beams that fit the map; weight of the best hypothesis | | 0 | 1 |
    | scan | 13 to 48 | in rooms: shortest range of the newest scan in 36 sectors, from ahead to the left, / 3.5 m | | 0 | 1 |
    | scan_age | 49 | in rooms: age of that scan, by its stamp; if located, the last two rows are 17 to 52 and 53 | s | 0 | 1 |

    ## Rewards

    A sum of named terms with weights, which the option ``reward`` changes and adds to, see `turtlebot_gym.rewards`: progress
    along the path through the waypoints, as a share of what full speed allows in a step; minus 0.1 per step; minus 0.01 times
    the squared speed and turning rate as shares of their limits; plus 10 at success. The total progress over a course is its
    length, whichever way it is driven. Distances are true ones.

    In rooms, progress is that along the *shortest path* through the room instead of the straight line. A collision costs 50,
    and each step 0.5 times the share of 0.15 m that the clearance lacks. In missions each goal adds 10.

    ## Starting State

    The robot is at rest. Nav and Pose: start pose and goal are drawn in a square of 4 m, at least 0.5 m apart. Square:
    the start is the origin. Rooms: room, start and goal are drawn, start and goal at least 1.5 m apart, and the first scan is
    complete. The initial belief is the first measurement with its variances; with ``filter="tutorial"`` it is the origin with
    the tutorial's P0.

    ## Episode End

    Termination: the last waypoint is reached, within 0.15 m (Nav), within 0.15 m, 0.2 rad and at most 0.5 rad/s (Pose),
    within 0.3 m (Square), or within 0.2 m (Rooms); by the true pose, or by the observed one with ``arrival="belief"``. With
    ``switch="time"`` there is no termination. In rooms an episode also terminates when the robot's footprint touches something.
    Truncation: after 300 steps (Square and Rooms: 600), by Gymnasium's ``TimeLimit``.

    ## Info

    At every step ``true_state`` (5,), ``odometry`` (3,), ``estimate`` (5,), ``covariance`` (3, 3), ``reference`` (3,),
    ``command`` (2,), ``distance`` (true, m), ``is_success``, and ``reward_shares`` (k,), what each term adds to the reward, in
    the order of ``env.unwrapped.reward_terms``. The arrays are new at every step. The covariance is that of the estimated pose.

    In rooms also ``clearance`` (from the footprint to the nearest object, m), ``path_length`` (driven since the start, m),
    ``way_left`` (length of the shortest path to the goal on a grid, at most 8 % too long, m) and ``collision``.

    ## Arguments

    Args:
        render_mode: None or "rgb_array"; for "human" `gymnasium.make` opens a window of its own.
        **options: The fields of `turtlebot_gym.Options`: task, robot, noise, filter, observation, and so on. The registered ids
            set ``task``. Gymnasium's own limit of steps is ``gym.make(..., max_episode_steps=...)``.

    Raises:
        ValueError: If an argument is out of its range.
        TypeError: If an argument is unknown.

    ## Version History

    * v0: first version.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # as Gymnasium declares it

    def __init__(self, *, render_mode: str | None = None, **options: Any) -> None:
        setup = common.with_limit(Options.of(options), math.inf)  # any other is TimeLimit's work
        parameters, waypoints, plan, system = setup
        self._batch = Batch(1, parameters, waypoints, system=system, plan=plan, shares=True)
        p = self.parameters
        self._own = self._world = (plan or p.room.rules) if p.room else None
        self.render_mode = choose("render_mode", render_mode, {mode: mode for mode in (None, "rgb_array")})
        self.metadata = {**self.metadata, "render_fps": max(1, round(1.0 / p.dt))}
        self.action_space, self.observation_space = common.spaces_of(system)
        self._numbers = {key: bool if key in common.FLAGS else float for key in common.ROOM_PARTS} if p.room else {}
        parts = [common.indices_of(self._batch, key, path) for key, path in common.PARTS.items()]
        self._batch.select(*parts, [common.indices_of(self._batch, key, common.ROOM_PARTS[key]) for key in self._numbers])
        self.reward_terms = tuple(term.name for term in system.rewards)
        """Names of the terms of the reward, in the order of ``info["reward_shares"]``."""
        self._everything = np.ones(1, np.bool_)
        self._started = self._seeded = False
        self.observation_terms = system.terms
        """The terms of an observation, in turn."""
        self._pictures = Pictures(self._batch, render_mode, rows=1)

    @property
    def parameters(self) -> Parameters:
        """Everything that the environment's transition depends on."""
        return self._batch.parameters_of(0)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start an episode: the first one of a seed, or the next.

        Args:
            seed: Seed of the episodes; None begins the next episode of the seed in use.
            options: For this episode only: ``start`` and ``goal``, each x and y, m, and perhaps a heading, rad, which is
                otherwise 0, where the task draws them; in missions the first goal. In rooms also ``world``, as the environment
                takes it.

        Raises:
            ValueError: If the seed or an option is invalid, or no path leads from start to goal.
        """
        for_episode = common.read_options(options, ("world", *_POSES) if self._own else _POSES)
        seed = None if seed is None else as_int("seed", seed)
        given = {}
        if self._own:
            self._enter(with_options(self._own, for_episode))
        elif for_episode:
            if not self.parameters.task.random:
                raise refusal(" and ".join(for_episode), "left out, or the waypoints of an environment of its own", for_episode)
            given = {name: given_pose(name, pose) for name, pose in for_episode.items()}
        super().reset(seed=seed)
        batch = self._batch
        if seed is None and self._seeded:
            batch.episodes += 1
        else:
            batch.seeds[0] = (self.np_random_seed if seed is None else seed) & MAX_SEED
            batch.episodes[0] = 0
            self._seeded = True
        observations, outcomes = batch.empty()
        batch.reset(self._everything, observations, outcomes, poses=given)
        info = self._info(float(outcomes[1, 0]), False, outcomes[common.FIRST_SHARE :, 0].copy())
        self._started = info.get("way_left") != UNKNOWN
        if not self._started:
            raise no_way(self.parameters.robot)
        self._pictures.begin(self._everything)
        return observations[0], info

    def _enter(self, world: RoomRules | FloorPlan) -> None:
        """Use a world from the next reset on."""
        if world is not self._world:
            p = self.parameters
            room = make_room(world, p.room.lidar, p.dt)
            self._batch.set_world(p._replace(room=room), world if isinstance(world, FloorPlan) else None)
            self._world = world

    def step(self, action: NDArray[np.float32]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Advance by one control interval.

        Args:
            action: Shape (2,), shares of the speed and turning rate limits; values beyond 1 are clipped.

        Raises:
            InvalidAction: If the action has another shape or is not finite.
            ResetNeeded: If no episode has begun.
        """
        if not self._started:
            raise ResetNeeded("Call reset() before step().")
        self._batch.given[0] = values = common.read_actions(action, (2,))
        forward, turn = values.tolist()
        if not math.isfinite(forward + turn):
            raise InvalidAction(f"Environment 0: an action must be finite, got {action!r}.")
        observations, outcomes = self._batch.step(self._batch.given)
        reward, distance, success, terminated, truncated, *_ = outcomes.ravel().tolist()
        info = self._info(distance, success != 0.0, outcomes[common.FIRST_SHARE :, 0])  # a view: what is held is not used again
        return observations[0], reward, terminated != 0.0, truncated != 0.0, info

    def _info(self, distance: float, success: bool, shares: NDArray[np.float64]) -> dict[str, Any]:
        """Return what ``info`` holds, in new arrays."""
        numbers, (true_state, odometry, estimate, covariance, reference, command, more) = self._batch.first
        info: dict[str, Any] = {  # the keys of `common.PARTS`, written out: a comprehension takes half as long again
            "true_state": numbers[true_state],
            "odometry": numbers[odometry],
            "estimate": numbers[estimate],
            "covariance": numbers[covariance],
            "reference": numbers[reference],
            "command": numbers[command],
        }
        if self._numbers:
            info |= {key: kind(value) for (key, kind), value in zip(self._numbers.items(), numbers[more], strict=True)}
        info |= {"distance": distance, "is_success": success, "reward_shares": shares}
        return info

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture of the world, (height, width, 3)."""
        pictures = self._pictures.render(self._started)
        return pictures[0] if pictures else None

    def snapshot(self) -> Snapshot:
        """Return the whole state, which holds more than ``info``: also what the sensors say."""
        return self._batch.world(0)
