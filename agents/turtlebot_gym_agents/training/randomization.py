"""Domain randomization: parameters that differ between environments."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from turtlebot_gym import NOISES, Noise, Parameters, make_filter
from turtlebot_gym.rooms.lidar import LIDARS
from turtlebot_gym.rooms.rules import ROOMS
from turtlebot_gym.systems import RoomParameters, make_room

PRESETS = ("clean", "tutorial", "documented", "rough")
"""Noise models to draw from; `wheel` is a different kind of odometry."""
NOISE_SCALE = (0.5, 1.5)
"""Range of the factor on the odometry's standard deviations."""
DELAYS = (0, 1)
"""Delays of commands in steps."""
WORLDS = {"dense": 6, "office": 3, "cellular": 2, "clutter": 1, "corridor": 1, "crowd": 1}
"""In rooms: worlds to draw from, with their weights."""
ALL_ROUND = ("lds01", "lds02", "a1", "ideal")
"""LiDARs to draw from in rooms, in equal shares: those that see all around."""


def randomized(
    base: Parameters, count: int, *, seed: int, speed_error: float = 0.02, turn_error: float = 0.0, veer: float = 0.0
) -> list[Parameters]:
    """Draw the parameters of the environments of a batch: noise model and scale, wheels, delay; in rooms also world and LiDAR.

    The filter is matched to the drawn noise, as on a robot whose odometry was calibrated. Unknown to it are errors of the
    executed speed and turning rate, as shares of them, up to ``speed_error``; further ones of the turning rate, up to
    ``turn_error``; and a turn per metre driven, up to ``veer``, rad/m.
    """
    random, wheels = np.random.default_rng(seed), np.random.default_rng([seed, 1])

    def draw_room() -> RoomParameters:
        lidars, share = tuple(LIDARS[name] for name in ALL_ROUND), np.array(tuple(WORLDS.values())) / sum(WORLDS.values())
        world = str(random.choice(tuple(WORLDS), p=share))
        return make_room(ROOMS[world], lidars[int(random.integers(len(lidars)))], base.dt)

    def draw() -> Parameters:
        noise = NOISES[PRESETS[int(random.integers(len(PRESETS)))]]
        size = random.uniform(*NOISE_SCALE) ** 2
        scale = 1.0 + random.uniform(-speed_error, speed_error)
        track = {"turn_scale": 1.0 + wheels.uniform(-turn_error, turn_error), "veer": wheels.uniform(-veer, veer)}
        model = Noise(
            process=replace(noise.process, scale=scale, **track),
            odometry=replace(noise.odometry, R=tuple(size * variance for variance in noise.odometry.R)),
        )
        delay = float(DELAYS[int(random.integers(len(DELAYS)))])
        room = draw_room() if base.room else base.room
        return base._replace(noise=model, tuning=make_filter("matched", model), delay=delay, room=room)

    return [draw() for _ in range(count)]
