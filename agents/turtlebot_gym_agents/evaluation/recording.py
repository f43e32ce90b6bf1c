"""An episode as a drive: with the room, its scans and what a localizer believes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from turtlebot_gym.drive import Drive, RoomData, Seen
from turtlebot_gym.localization.bank import followed
from turtlebot_gym.models.angles import TWO_PI
from turtlebot_gym.rooms.charting import BORDER
from turtlebot_gym.rooms.grid import GridMap, charted
from turtlebot_gym.rooms.rules import GIVEN
from turtlebot_gym.rooms.scan import Obstacles, Scan, mounted, obstacles_of
from turtlebot_gym.rooms.scene import Scene
from turtlebot_gym.systems import Parameters, Snapshot
from turtlebot_gym.values import Pose, State
from turtlebot_gym_agents.evaluation.driving import driven
from turtlebot_gym_agents.evaluation.episodes import ending_of
from turtlebot_gym_agents.evaluation.evaluate import driver_of, make_envs, policy_of, require_known
from turtlebot_gym_agents.evaluation.surroundings import room_of, scene_of, tracks_of
from turtlebot_gym_agents.front.results import name_of
from turtlebot_gym_agents.ids import environment_id
from turtlebot_gym_agents.policies import Policy
from turtlebot_gym_agents.policies.fit import parameters_of


class _Row(NamedTuple):
    info: dict[str, Any]
    room: Obstacles | None
    ranges: NDArray[np.float32] | None
    """Ranges of the newest scan, shape (beams,), m."""
    hypotheses: NDArray[np.float64]
    """Of a localizer, see `Drive.hypotheses`."""


def record_episode(
    policy: str | Path | Policy,
    *,
    env: str = "nav",
    seed: int = 0,
    label: str | None = None,
    allow_mismatch: bool = False,
    **options: Any,
) -> Drive:
    """Drive an episode and return it: the first episode of `evaluate` with the same arguments.

    Args:
        policy: A name for `turtlebot_gym_agents.make_policy`, a policy, or "oracle" in rooms.
        env: The id of an environment of this package, or its short name.
        seed: Seed of the episode.
        label: Label of the drive; by default the policy's name.
        allow_mismatch: Whether a policy made for another task, observation, robot or rate may drive.
        **options: The environment's, see `turtlebot_gym.Options`.

    Raises:
        ValueError: If an argument is unknown or out of its range.
    """
    env, policy = environment_id(env), policy_of(policy)
    require_known(env, seed)
    envs = make_envs(env, 1, **options)
    try:
        p = parameters_of(envs)
        driver = driver_of(policy, envs, allow_mismatch=allow_mismatch)
        rows = list(_rows(envs, driver, seed, p))
        around = room_of(envs, label or name_of(policy))._replace(chart=_chart_of(scene_of(envs), p))
    finally:
        envs.close()
    return _episode(rows, p, around)


def _hypotheses_of(world: Snapshot, scene: Scene | None, p: Parameters) -> NDArray[np.float64]:
    """Return where else a robot that localizes itself may be."""
    if scene is None or not p.localizer:
        return np.empty((0, 4))
    located: Any = world.estimate
    return followed(located, scene.memory.bank, Pose(*scene.memory.trail[0, 1:4].tolist()), p.localizer)


def _rows(envs: VectorEnv, policy: Policy, seed: int, p: Parameters) -> Iterator[_Row]:
    """Yield the environment's data at the start and after each step of an episode."""
    for moment in driven(envs, policy, seed=seed, episodes=1):
        scene = scene_of(envs)
        room = None if scene is None else obstacles_of(scene)
        world: Snapshot = envs.unwrapped.snapshot(0)  # pyright: ignore[reportAttributeAccessIssue]
        fix = getattr(world.senses, "fix", None)
        sensed = {} if fix is None else {"fix": np.array([float(fix.arrived)])}
        tracks = tracks_of(envs)
        sensed |= {} if tracks is None else {"tracks": tracks[None]}
        yield _Row(
            moment.info | sensed, room, None if scene is None else scene.lidar.ranges[1].copy(), _hypotheses_of(world, scene, p)
        )


def _episode(rows: Sequence[_Row], p: Parameters, around: RoomData) -> Drive:
    infos = [{name: values[0] for name, values in row.info.items()} for row in rows]
    rooms = [row.room for row in rows if row.room]
    last = infos[-1]
    walking = any(room.circles != rooms[0].circles for room in rooms)
    drive = Drive.stack(
        infos,
        time=p.dt * np.arange(len(infos)),
        circles=tuple(np.array(room.circles).reshape(-1, 3) for room in rooms) if walking else (),
        hypotheses=tuple(row.hypotheses for row in rows),
        around=around._replace(room=rooms[0] if rooms else None),
        outcome=ending_of(last["is_success"], last.get("collision", False), p.dt * (len(infos) - 1)),
    )
    return replace(drive, scans=_scans(rows, drive, p))


def _scans(rows: Sequence[_Row], drive: Drive, p: Parameters) -> tuple[Seen, ...]:
    """Return the scans, each at the step in which it became the newest one."""
    if not p.room:
        return ()
    lidar = p.room.lidar
    scans: list[Seen] = []
    last: NDArray[np.float32] | None = None
    for at, row in enumerate(rows):
        assert row.ranges is not None
        # Between two scans the newest one stays as it is.
        if last is None or not np.array_equal(row.ranges, last):
            last = row.ranges
            scan = Scan(last[: lidar.beams], 0.0, TWO_PI / lidar.beams, lidar.range_min, lidar.range_max)
            place = mounted(State(*drive.true_state[at].tolist()), lidar)
            scans.append(Seen(at, place, scan, mount=Pose(lidar.x, lidar.y, lidar.yaw)))
    return tuple(scans)


def _chart_of(scene: Scene | None, p: Parameters) -> GridMap | None:
    """Return the map by which a robot localizes itself in a drawn room; None if there is none."""
    if scene is None or not p.localizer or p.room.rules.kind == GIVEN:
        return None
    return charted(scene, BORDER - 1)  # one cell of the border is drawn
