"""The plant: the environment's own transition."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np

from cmd_vel_guard.values import Mount
from turtlebot_gym.config import Range, check_fields
from turtlebot_gym.heart import Episode
from turtlebot_gym.models.angles import TWO_PI
from turtlebot_gym.models.random import MAX_SEED
from turtlebot_gym.rooms.geodesic import UNKNOWN
from turtlebot_gym.rooms.grid import GridMap, charted
from turtlebot_gym.rooms.lidar import Lidar, beams_by
from turtlebot_gym.rooms.scan import Clearance, Obstacles, Scan, obstacles_of
from turtlebot_gym.rooms.worlds import no_way
from turtlebot_gym.systems import Options
from turtlebot_gym.tasks import MISSION, NAV, ROOM
from turtlebot_gym.values import STOP, Command, Fix, Odometry, Pose, State
from turtlebot_gym_ros.node.block import PERIOD, TF, Every, Input, Output, Stamped, Transform

NO_FIX = ("none", "")
FIX_OUTPUTS = {"fix": Output(topic="pose_fix", type=Fix, newest=True)}
ROOM_OUTPUTS = {
    "scan": Output(topic="scan", type=Scan, newest=True),
    "goal": Output(topic="room_goal", type=Pose),
    "clearance": Output(topic="clearance", type=Clearance),
    "obstacles": Output(topic="obstacles", type=Obstacles),
}
MAP_OUTPUTS = {"map": Output(topic="map", type=GridMap, latched=True)}
OPEN_GROUND = ("open", "")
SHOWN_EVERY = 5
"""Steps between two pictures of the obstacles."""


class TurtlebotSimulator:
    """Simulate a TurtleBot: each step is the environment's, with the same noise for the same seed and episode.

    In a ``world`` it is in the room that `TurtleBotRooms-v0` draws for that seed and episode, with a LiDAR. Contact is judged
    as there, but nothing is solid: an episode's first contact is reported, and the robot drives on. With ``goals`` it gives
    several goals in turn, as `TurtleBotMissions-v0` does.

    Inputs: ``command`` (`Command`, on ``cmd_vel``; held indefinitely, as on a TurtleBot3). Outputs: ``truth`` (`State`, on
    ``true_state``) and ``odometry`` (`Odometry`, on ``odom``: the measured pose, marked if it dropped out, with the twist that
    the wheels executed); with a ``fix`` also ``fix`` (`Fix`, on ``pose_fix``, stamped with the time of the measurement). In a
    room ``scan`` (`Scan`, on ``scan``, when it is complete, with the LiDAR's stamps, in its own frame), ``goal`` (`Pose`, on
    ``room_goal``), ``clearance`` (`Clearance`, on ``clearance``), and ``obstacles`` (`Obstacles`, on ``obstacles``), a picture
    for viewers; of a map, or with a ``localizer``, ``map`` (`GridMap`, on ``map``), once an episode.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Params:
        """Parameters of the simulator."""

        robot: str = "burger"
        """A name in `turtlebot_gym.robots.ROBOTS`, or a FILE.yaml."""
        noise: str = "tutorial"
        """A name in `turtlebot_gym.presets.NOISES`, or a FILE.yaml."""
        fix: str = "none"
        """External pose sensor: none, a name in `turtlebot_gym.presets.FIXES`, or a FILE.yaml."""
        period: Annotated[float, PERIOD] = 0.1
        """Period of the odometry and of the simulation, s."""
        seed: Annotated[int, Range(0, MAX_SEED, whole=True)] = 0
        """Seed of the noise."""
        publish_tf: bool = False
        """Whether to publish odometry on ``/tf`` and the LiDAR on ``/tf_static``; needs ``tf2_msgs``. A robot's bring-up does.
        """
        world: str = "open"
        """Room: "open" for none, one of `turtlebot_gym.rooms.rules.ROOMS`, a Gazebo world, or a map. A map is its YAML file."""
        lidar: str = "lds01"
        """The LiDAR in a room, a name in `turtlebot_gym.rooms.lidar.LIDARS`, or a file."""
        goals: Annotated[int, Range(0, 2**31, whole=True)] = 0
        """Number of goals that a world gives in turn; 0 for a single one. Each follows when the one before is reached by belief
        or given up after a minute."""
        localizer: str = ""
        """Localizer by whose belief goals in turn are reached; empty for the filter. It is a name in
        `turtlebot_gym.localization.tuning.LOCALIZERS`, or a file; for it the map of a drawn room is published."""
        odom_frame: str = ""
        """Frame of the odometry, if it is not the world's: the map's then, with a localizer."""

        def __post_init__(self) -> None:
            check_fields(self, "")
            if self.goals and not self.in_room:
                raise ValueError("goals must be 0 without a world: goals in turn are drawn in a room.")

        @property
        def in_room(self) -> bool:
            """Whether there is a room around the robot."""
            return self.world not in OPEN_GROUND

    inputs = {"command": Input(topic="cmd_vel", type=Command, max_age=None, required=False, lock_step="same")}
    outputs = {"truth": Output(topic="true_state", type=State), "odometry": Output(topic="odom", type=Odometry)}
    trigger = Every(0.1, plant=True)

    def __init__(self, params: Params) -> None:
        room = replace(MISSION, laps=params.goals) if params.goals else ROOM
        task = replace(room if params.in_room else replace(NAV, random=False), max_steps=math.inf)
        p, _, plan, _ = Options(
            task=task,
            robot=params.robot,
            noise=params.noise,
            dt=params.period,
            fix=None if params.fix in NO_FIX else params.fix,
            world=params.world if params.in_room else None,
            lidar=params.lidar if params.in_room else None,
            localizer=params.localizer or None,
        ).setup()
        self.trigger = replace(self.trigger, period=params.period)
        self._sees_fixes, self._lidar = bool(p.fix), p.room.lidar if p.room else None
        self._episode = Episode(p, (Pose(0.0, 0.0, 0.0),), seed=params.seed, plan=plan)  # other nodes handle the waypoints
        self._draws_map = bool(p.localizer) and not (plan and plan.map)
        self._map = charted(self._episode.scene) if self._draws_map else (plan.map if plan else None)
        frame = params.odom_frame or None
        self.outputs = (
            (MAP_OUTPUTS if self._map else {}) | self.outputs | {"odometry": replace(self.outputs["odometry"], frame=frame)}
        )  # a localizer waits for the map
        if params.publish_tf:
            self.outputs |= {"tf": replace(TF, frame=frame)}
        if self._sees_fixes:
            self.outputs |= FIX_OUTPUTS
        if self._lidar:
            mount = Mount(p.robot.lidar.frame or "base_scan", self._lidar.x, self._lidar.y, self._lidar.yaw)
            self.outputs |= ROOM_OUTPUTS | {"scan": replace(ROOM_OUTPUTS["scan"], mount=mount)}
        if plan and self._episode.world.room.way == UNKNOWN:
            raise no_way(p.robot)
        self._begun = False
        self.notice: str | None = None
        """Notice of the episode's first contact."""

    def reset(self) -> None:
        """Begin the next episode."""
        self._episode.reset()
        if self._draws_map:
            self._map = charted(self._episode.scene)
        self._begun = False
        self.notice = None

    def step(self, dt: float, command: Command | None) -> dict[str, Any]:
        """Return the first measurement on the first call, and the result of a control interval on later ones."""
        if self._begun:
            self._episode.step(command or STOP)
        self._begun = True
        world = self._episode.world
        odometry = world.senses.odometry
        values: dict[str, Any] = {"truth": world.body.true_state, "odometry": odometry}
        if "tf" in self.outputs and odometry.measured:
            values["tf"] = Transform(odometry.pose)
        if self._sees_fixes and (now := world.senses.fix).arrived:
            values["fix"] = Stamped(Fix(now.pose, now.R, now.age, now.arrived, now.cross), now.age)
        if self._map:
            values["map"], self._map = self._map, None
        if self._lidar:
            values |= self._look_round(self._lidar)
        return values

    def _look_round(self, lidar: Lidar) -> dict[str, Any]:
        """Return the outputs about the room; a scan only when one is complete."""
        episode, dt = self._episode, self._episode.parameters.dt
        at, room = int(episode.world.steps), episode.world.room
        if room.collided and self.notice is None:
            self.notice = f"contact after {at * dt:.1f} s: the environment's episode ends here."
        values: dict[str, Any] = {"goal": episode.world.course.reference, "clearance": Clearance(room.clearance)}
        if at == 0 or beams_by(at, lidar, dt) // lidar.beams > beams_by(at - 1, lidar, dt) // lidar.beams:
            beam_period = 1.0 / (lidar.rate * lidar.beams) if lidar.turning else 0.0
            is_blind = np.isinf(episode.scene.lidar.beams[2, : lidar.beams])
            ranges = np.where(is_blind, np.float32(np.nan), episode.scene.lidar.ranges[1, : lidar.beams])
            scan = Scan(ranges, 0.0, TWO_PI / lidar.beams, lidar.range_min, lidar.range_max, beam_period, 1.0 / lidar.rate)
            values["scan"] = Stamped(scan, room.scan_age)
        if at % SHOWN_EVERY == 0:
            values["obstacles"] = obstacles_of(episode.scene)
        return values
