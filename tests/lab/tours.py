"""Simulated tours of a room with scans: what a person records who drives a robot about in order to calibrate or to map."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym import Options
from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.drive import Drive, Seen
from turtlebot_gym.models.angles import TWO_PI
from turtlebot_gym.parameters import ProcessNoise
from turtlebot_gym.presets import WHEEL
from turtlebot_gym.rooms.lidar import LIDARS, SECTORS, SIGHT, Lidar, beams_by
from turtlebot_gym.rooms.scan import Scan
from turtlebot_gym.values import Pose

HOLD = 15
"""Steps for which a motion is held."""
BLOCKED = 0.5
"""Range ahead below which the robot turns to the open side, m."""


class Tour(NamedTuple):
    """A simulated tour, and what only the simulation knows."""

    drive: Drive
    """Odometry, scans and, as its truth, the true poses."""
    field: NDArray[np.float32]
    """Distances to the surfaces of the room, see `rooms.field` ..."""
    frame: NDArray[np.float64]
    """... and their frame."""
    start: Pose


def _motion(
    random: np.random.Generator, ranges: NDArray[np.float32], before: NDArray[np.float64], is_new: bool
) -> NDArray[np.float64]:
    """Return an action: straight ahead, a turn on the spot or an arc, and a turn to the open side where the way is blocked."""
    is_blocked = min(ranges[:5].min(), ranges[-4:].min()) < BLOCKED
    if is_new:
        arc, turn = random.uniform(-0.25, 0.25), random.uniform(0.1, 0.35) * random.choice((-1.0, 1.0))
        ahead = random.uniform(0.5, 1.0)
        before = np.array(((ahead, 0.0), (0.0, turn), (ahead, arc))[random.integers(3)])
    if is_blocked and before[0] > 0.0:
        return np.array((0.0, 0.3 if ranges[3:12].mean() > ranges[-11:-2].mean() else -0.3))
    return before


def simulated_tour(
    world: str = "office",
    *,
    seed: int,
    wheels: ProcessNoise = WHEEL.process,
    lidar: Lidar = LIDARS["lds01"],
    time: float = 150.0,
    generator: np.random.Generator | None = None,
    **options: Any,
) -> Tour:
    """Return a tour by the environment's own simulation.

    Args:
        world: Name of a world, in which a seed draws the room.
        seed: Seed of the room and of the noise.
        wheels: What the robot's wheels do; neither odometry nor localizer knows it.
        lidar: The LiDAR with its mount.
        time: Length, s.
        generator: Draws the motions; by default that of the seed.
        **options: Further options of the environment, such as `walkers`.
    """
    random = np.random.default_rng(seed) if generator is None else generator
    p, waypoints, plan, _ = Options(world=world, lidar=lidar, noise="wheel", localizer="match", **options).setup()
    batch = Batch(1, p._replace(noise=replace(WHEEL, process=wheels)), waypoints, plan=plan)
    batch.seeds[:] = seed
    observations, outcomes = batch.empty()
    batch.reset(np.ones(1, np.bool_), observations, outcomes)
    true, beam, action = [batch.numbers("body.true_state")[0]], 1.0 / (lidar.rate * lidar.beams), np.zeros(2)
    start = Pose(*true[0][:3].tolist())
    twists, odometry, scans = [np.zeros(2)], [batch.numbers("senses.odometry.pose")[0]], []
    for step in range(1, round(time / p.dt) + 1):
        action = _motion(random, observations[0, -SECTORS - 1 : -1] * SIGHT, action, step % HOLD == 1)
        twists.append(batch.numbers("body.command")[0])
        observations, _ = batch.step(action.astype(np.float32)[None])
        odometry.append(batch.numbers("senses.odometry.pose")[0])
        true.append(batch.numbers("body.true_state")[0])
        turns = beams_by(step, lidar, p.dt) // lidar.beams
        if turns > beams_by(step - 1, lidar, p.dt) // lidar.beams:
            ranges = batch.scenes.lidar.ranges[0, 1, : lidar.beams].copy()
            scan = Scan(ranges, 0.0, TWO_PI / lidar.beams, lidar.range_min, lidar.range_max, beam)
            scans.append(Seen(step, start, scan, (turns - 1.0) / lidar.rate + beam, Pose(lidar.x, lidar.y, lidar.yaw)))
    clock = p.dt * np.arange(len(twists), dtype=np.float64)
    drive = Drive(
        time=clock, twist=np.array(twists), odometry=np.array(odometry), true_state=np.array(true), scans=tuple(scans)
    )
    memory = batch.scenes.memory
    return Tour(drive, memory.field[0], memory.field_frame[0], start)
