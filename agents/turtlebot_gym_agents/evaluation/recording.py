"""An episode as a drive: with the room, its scans and what a localizer believes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.drive import Drive, RoomData, Seen
from turtlebot_gym.localization.bank import followed
from turtlebot_gym.models.angles import TWO_PI
from turtlebot_gym.rooms.grid import BORDER, charted, grid_in
from turtlebot_gym.rooms.rules import GIVEN
from turtlebot_gym.rooms.scan import Scan, mounted, obstacles_of
from turtlebot_gym.rooms.scene import scene_at
from turtlebot_gym.systems import Parameters
from turtlebot_gym.values import Pose, State
from turtlebot_gym_agents.evaluation.driving import driven
from turtlebot_gym_agents.evaluation.episodes import ending_of
from turtlebot_gym_agents.evaluation.evaluate import driving, policy_of, require_known
from turtlebot_gym_agents.front.results import name_of
from turtlebot_gym_agents.ids import environment_id
from turtlebot_gym_agents.policies import Policy
from turtlebot_gym_agents.policies.fit import parameters_of


def record_episode(
    policy: str | Path | Policy,
    *,
    env: str | None = None,
    seed: int = 0,
    label: str | None = None,
    allow_mismatch: bool = False,
    **options: Any,
) -> Drive:
    """Return the first episode of `evaluate` with the same arguments; ``label`` is by default the policy's name."""
    env, policy = environment_id(env, options), policy_of(policy)
    require_known(env, seed)
    infos, rooms, ranges, hypotheses = list[dict[str, Any]](), list[Any](), list[Any](), list[NDArray[np.float64]]()
    with driving(policy, env, 1, allow_mismatch=allow_mismatch, **options) as (envs, driver):
        p, bare, scene = parameters_of(envs), cast(Any, envs.unwrapped), cast(Any, None)
        for moment in driven(envs, driver, seed=seed, episodes=1):
            world, elsewhere = bare.snapshot(0), np.empty((0, 4))
            infos.append({name: values[0] for name, values in moment.info.items()})
            if (fix := getattr(world.senses, "fix", None)) is not None:
                infos[-1]["fix"] = float(fix.arrived)
            if p.room:
                scenes = bare.truth()[0]
                scene = scene_at(scenes, 0)
                rooms.append(obstacles_of(scene))
                ranges.append(scene.lidar.ranges[1].copy())
                if scenes.tracker:
                    infos[-1]["tracks"] = scenes.tracker.seen[0].copy()
                if p.localizer:
                    trail = Pose(*scene.memory.trail[0, 1:4].tolist())
                    elsewhere = followed(world.estimate, scene.memory.bank, trail, p.localizer)
            hypotheses.append(elsewhere)
    chart = rooms and p.localizer and p.room.rules.kind != GIVEN  # in a drawn room, by this map
    around = RoomData(
        label=label or name_of(policy),
        room=rooms[0] if rooms else None,
        grid=grid_in(scene) if rooms else None,
        chart=charted(scene, BORDER - 1) if chart else None,  # one cell of the border is drawn
        robot_radius=p.robot.radius,
        goal_radius=p.task.radius,
    )
    last = infos[-1]
    walking = any(room.circles != rooms[0].circles for room in rooms)
    drive = Drive.stack(
        infos,
        time=p.dt * np.arange(len(infos)),
        circles=tuple(np.array(room.circles).reshape(-1, 3) for room in rooms) if walking else (),
        hypotheses=tuple(hypotheses),
        around=around,
        outcome=ending_of(last["is_success"], last.get("collision", False), p.dt * (len(infos) - 1)),
    )
    return replace(drive, scans=_scans(ranges, drive, p))


def _scans(ranges: Sequence[NDArray[np.float32]], drive: Drive, p: Parameters) -> tuple[Seen, ...]:
    """Return the scans, each at the step in which it became the newest one."""
    scans, last = list[Seen](), None
    lidar: Any = p.room.lidar if p.room else None
    for at, row in enumerate(ranges if lidar else ()):
        if last is None or not np.array_equal(row, last):  # between two scans the newest one stays as it is
            last = row
            scan = Scan(row[: lidar.beams], 0.0, TWO_PI / lidar.beams, lidar.range_min, lidar.range_max)
            place = mounted(State(*drive.true_state[at].tolist()), lidar)
            scans.append(Seen(at, place, scan, mount=Pose(lidar.x, lidar.y, lidar.yaw)))
    return tuple(scans)
