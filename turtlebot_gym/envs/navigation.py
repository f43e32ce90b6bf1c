"""The scalar environment: one TurtleBot that navigates on its filter's estimate."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.error import InvalidAction, ResetNeeded
from numpy.typing import NDArray

from turtlebot_gym.envs.common import (
    FLAGS,
    PARTS,
    ROOM_PARTS,
    SYMMETRIC,
    Room,
    action_space,
    make_batch,
    observation_space,
    read_options,
    warn_of_a_limit,
)
from turtlebot_gym.envs.pictures import make_renderer
from turtlebot_gym.models.random import MAX_SEED
from turtlebot_gym.parameters import FilterTuning, FixNoise, Noise, Reward
from turtlebot_gym.plants import MujocoBurger
from turtlebot_gym.robots import Robot
from turtlebot_gym.systems import Parameters
from turtlebot_gym.tasks import Task
from turtlebot_gym.validation import choose, whole
from turtlebot_gym.values import Pose


class NavigationEnv(gym.Env[NDArray[np.float32], NDArray[np.float32]]):
    """A differential-drive robot that navigates on the estimate of an extended Kalman filter.

    ## Description

    A unicycle executes velocity commands with slip and process noise; its odometry is noisy, spiky, biased or drifting;
    a Kalman filter estimates its state. The policy sees the filter's estimate and drives to a goal.

    ## Action Space

    ``Box(-1, 1, (2,), float32)``: forward speed and turning rate as shares of the robot's limits. Values beyond 1 are
    clipped. The command is then scaled into the limits per axis and per wheel, which keeps the curvature of the path.

    ## Observation Space

    ``Box((13,), float32)`` with finite bounds, to which observations are clipped. All entries follow from the estimated
    pose (with ``observation="odometry"`` from the measured one, with ``"truth"`` from the true one).

    | # | Observation | Unit | Min | Max |
    |---|---|---|---|---|
    | 0 | distance to the waypoint | m | 0 | 20 |
    | 1, 2 | cosine and sine of its bearing in the body frame; (1, 0) at distance 0 | | -1 | 1 |
    | 3, 4 | cosine and sine of the heading still to turn | | -1 | 1 |
    | 5 | speed / limit | | -2 | 2 |
    | 6 | turning rate / limit | | -2 | 2 |
    | 7 | stated standard deviation of the position (of the odometry; 0 for the truth) | m | 0 | 5 |
    | 8 | stated standard deviation of the heading | rad | 0 | pi |
    | 9 | normalized innovation squared of the last measurement | | 0 | 25 |
    | 10 | distance to the waypoint after this one; to this one again if there is none | m | 0 | 20 |
    | 11, 12 | cosine and sine of its bearing | | -1 | 1 |

    ## Rewards

    Progress along the path through the waypoints, as a share of what full speed allows in a step; minus 0.1 per step;
    minus 0.01 times the squared speed and turning rate as shares of their limits; plus 10 at success. The total
    progress over a course is its length, whichever way it is driven. Distances are true ones. The weights are
    `turtlebot_gym.Reward`.

    ## Starting State

    The robot is at rest. Nav and Pose: start pose and goal are drawn in a square of 4 m, at least 0.5 m apart. Square:
    the start is the origin. The initial belief is the first measurement with its variances; with ``filter="tutorial"``
    it is the origin with the tutorial's P0.

    ## Episode End

    Termination: the last waypoint is reached, within 0.15 m (Nav), within 0.15 m, 0.2 rad and at most 0.5 rad/s (Pose), or
    within 0.3 m (Square); by the true pose, or by the observed one with ``arrival="belief"``. With ``switch="time"`` there
    is no termination. Truncation: after 300 steps (Square: 600), by Gymnasium's ``TimeLimit``.

    ## Info

    At every step ``true_state`` (5,), ``odometry`` (3,), ``estimate`` (5,), ``covariance`` (5, 5), ``reference`` (3,),
    ``command`` (2,), ``distance`` (true, m) and ``is_success``. They are parts of a buffer that is new at every step.

    ## Arguments

    Args:
        task: "nav", "pose", "square" or a `turtlebot_gym.Task`; the registered ids set it. A finite ``max_steps`` of a Task
            truncates too; Gymnasium's own limit is ``gym.make(..., max_episode_steps=...)``.
        robot: "burger", "waffle", "turtlebot4", "tutorial", a file (FILE.yaml), or a `turtlebot_gym.Robot`.
        noise: "clean", "tutorial", "documented", "wheel", "rough", a file (FILE.yaml), or a `turtlebot_gym.Noise`.
        filter: "matched", "tutorial", "gated", "mixture", "slip", "scale", or a `turtlebot_gym.FilterTuning`.
        integrator: "euler" or "midpoint".
        observation: "ekf", "odometry" or "truth".
        reward: Weights, a `turtlebot_gym.Reward`.
        arrival: "truth" or "belief".
        switch: "arrival" or "time"; like the next two arguments, for tasks with given waypoints.
        laps: Number of rounds through the waypoints.
        waypoints: Poses to visit instead of the square.
        dt: Control interval, s.
        delay: Delay of commands in steps, 0 to 3.
        fix: An external pose sensor that gives the filter a measurement now and then: "beacons", "late",
            "localization", "markers", "motion-capture", a file (FILE.yaml), or a `turtlebot_gym.FixNoise`; None for
            none.
        plant: Model of the motion: "unicycle", "mujoco" or a `turtlebot_gym.plants.MujocoBurger`. In MuJoCo the wheels creep
            and slip by contact physics instead of the noise of execution, and odometry comes from their angles; it needs the
            extra [mujoco], and a step takes a hundred times as long.
        render_mode: None, "human" or "rgb_array".

    Raises:
        ValueError: If an argument is unknown or out of its range.
        ImportError: If the plant needs an engine that is not installed.

    ## Version History

    * v0: first version, observation layout 1.
    """

    _room: Room | None = None
    metadata = {"render_modes": ["human", "rgb_array"], "render_fps": 10}  # as Gymnasium declares it

    def __init__(
        self,
        *,
        task: str | Task = "nav",
        robot: str | Robot = "burger",
        noise: str | Noise = "tutorial",
        filter: str | FilterTuning = "matched",
        integrator: str = "euler",
        observation: str = "ekf",
        reward: Reward | None = None,
        arrival: str = "truth",
        switch: str | None = None,
        laps: int | None = None,
        waypoints: Sequence[Pose] | None = None,
        dt: float = 0.1,
        delay: int = 0,
        fix: str | FixNoise | None = None,
        plant: str | MujocoBurger = "unicycle",
        render_mode: str | None = None,
    ) -> None:
        self._batch = make_batch(
            1,
            task,
            waypoints=waypoints,
            arrival=arrival,
            switch=switch,
            laps=laps,
            max_steps=None if isinstance(task, Task) and not self._room else math.inf,  # else TimeLimit's work alone
            robot=robot,
            noise=noise,
            filter=filter,
            integrator=integrator,
            observation=observation,
            reward=reward,
            dt=dt,
            delay=delay,
            fix=fix,
            plant=plant,
            room=self._room,
        )
        self.render_mode = choose("render_mode", render_mode, {mode: mode for mode in (None, "human", "rgb_array")})
        self.metadata = {**self.metadata, "render_fps": max(1, round(1.0 / dt))}
        self.action_space = action_space()
        self.observation_space = observation_space(self._batch.system)
        slices = self._batch.layout.world.slices
        self._slices = [(key, slices[path]) for key, path in PARTS.items() if key != "covariance"]
        names, told = self._batch.layout.world.names, ROOM_PARTS if self.parameters.room else {}
        self._numbers = {key: (names.index(path), bool if key in FLAGS else float) for key, path in told.items()}
        self._covariance = SYMMETRIC + slices[PARTS["covariance"]].start
        self._action = np.zeros((1, 2), np.float32)
        self._everything = np.ones(1, np.bool_)
        self._started = False
        self._seeded = False
        self._renderer: Any = None

    @property
    def parameters(self) -> Parameters:
        """Everything that the environment's transition depends on."""
        parameters = self._batch.parameters
        assert isinstance(parameters, Parameters)
        return parameters

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start an episode: the first one of a seed, or the next.

        Args:
            seed: Seed of the episodes; None begins the next episode of the seed in use.
            options: Ignored; there are none.

        Raises:
            ValueError: If the seed is no whole number, or negative, or there is an option.
        """
        if not self._room:
            read_options(options, ())
        seed = None if seed is None else whole("seed", seed)
        super().reset(seed=seed)
        batch = self._batch
        if self._started and self.spec is not None and self.parameters.task.max_steps < math.inf:
            warn_of_a_limit(self.spec.id, batch.numbers("steps")[0], self.parameters.task.max_steps)
        if seed is None and self._seeded:
            batch.episodes += 1
        else:
            batch.seeds[0] = (self.np_random_seed if seed is None else seed) & MAX_SEED
            batch.episodes[0] = 0
            self._seeded = True
        observations, outcomes = batch.empty()
        batch.reset(self._everything, observations, outcomes)
        self._started = True
        if self.render_mode == "human":
            self._draw(anew=True)
        elif self._renderer is not None:
            self._renderer.reset()
        return observations[0], self._info(outcomes[1, 0], False)

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
        values = np.asarray(action, np.float32)
        if values.shape != (2,):
            raise InvalidAction(f"Environment 0: an action has shape (2,), got {values.shape}.")
        self._action[0] = values
        forward, turn = values.tolist()
        if not math.isfinite(forward + turn):
            raise InvalidAction(f"Environment 0: an action must be finite, got {action!r}.")
        observations, outcomes = self._batch.step(self._action)
        reward, distance, success, terminated, truncated, _ = outcomes.ravel().tolist()
        if self.render_mode == "human":
            self._draw()
        return (
            observations[0], reward, terminated != 0.0, truncated != 0.0, self._info(distance, success != 0.0)
        )  # fmt: skip

    def _info(self, distance: float, success: bool) -> dict[str, Any]:
        """Return what ``info`` holds, as views of a fresh copy of the world."""
        numbers = self._batch.first_world()
        info: dict[str, Any] = {key: numbers[part] for key, part in self._slices}
        info["covariance"] = numbers[self._covariance]
        if self._numbers:
            info |= {key: kind(numbers[at]) for key, (at, kind) in self._numbers.items()}
        info["distance"] = float(distance)
        info["is_success"] = success
        return info

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture of the world, (height, width, 3), in mode "rgb_array"; the mode "human" draws by itself.

        Raises:
            ResetNeeded: If no episode has begun.
        """
        if self.render_mode is None:
            gym.logger.warn("render() needs a render_mode: make the environment with render_mode='rgb_array'.")
            return None
        if not self._started:
            raise ResetNeeded("Call reset() before render().")
        return self._draw() if self.render_mode == "rgb_array" else None

    def _draw(self, *, anew: bool = False) -> NDArray[np.uint8] | None:
        """Draw the world; ``anew`` begins with empty trails."""
        if self._renderer is None:
            mode = "human" if self.render_mode == "human" else "rgb_array"
            self._renderer = make_renderer(self._batch, 0, mode, fps=self.metadata["render_fps"])
        elif anew:
            self._renderer.reset()
        return self._renderer.draw(self._batch.world(0))

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None
