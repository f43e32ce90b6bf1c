"""Drive rooms in the live graph by a simulator that speaks like a recorded robot, beside one with perfect messages.

Each room is driven four times in lock-step: by perfect messages and by those of the robot, without and behind a guard with its
collision monitor. The first contact or arrival by the true pose ends a drive. Differences are paired by room, and their
intervals hold 95 %. Finished drives are kept under `out/`, so an interrupted run resumes.

In lock-step messages change nothing, so all rooms are driven by the nodes' code in one process, which takes a ninth of the
time. The first ``live`` rooms are driven in the live graph, too, and must end at the same time in the same way.

The guard's decisions are those of its node, 50 a second, in simulated time, on the robot: between simulator and wheels.
"""

from __future__ import annotations

import multiprocessing
import os
from collections import Counter, deque
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar
from unittest.mock import patch

import numpy as np
from rich.table import Table

from harness.study import Study, each, finished, run
from turtlebot_gym.tasks import ROOM, arrived
from turtlebot_gym.values import STOP, Command, Pose
from turtlebot_gym_agents.evaluation.metrics import Interval, paired_share_difference, share
from turtlebot_gym_agents.provenance import provenance
from turtlebot_gym_ros import Graph
from turtlebot_gym_ros.blocks import KalmanFilter, TurtlebotSimulator, VelocityController
from turtlebot_gym_ros.graph.bringup import room_metrics
from turtlebot_gym_ros.node.block import Aged
from turtlebot_gym_ros.nodes import load
from turtlebot_gym_ros.robot.arbiter import Arbiter, Parameters
from turtlebot_gym_ros.robot.collision import RawScan

DOMAIN = 216
"""First of the ROS domains, one for each worker."""
FIRST = 1_100_000
"""Seed of the first room; neither a policy nor the safety layer was tuned on rooms from this one on."""
LONGEST = 60.0
"""Time after which a drive ends, s."""
LOOK = 2.0
"""Simulated time between two looks at a drive, s."""
LAST = 10.0
"""Time before the end of a drive over which its reason is looked for, s."""
GUARD = 0.02
"""Period of the guard, s."""
ENDS = ("goal reached", "collision", "end of the episode", "least clearance")
"""What drives in the live graph must have in common with those without it."""
ARMS = ((False, False), (True, False), (False, True), (True, True))
"""Whether the simulator speaks like the robot, and whether the guard's collision monitor is on."""


@dataclass(frozen=True, kw_only=True)
class Config(Study):
    """Drive rooms by a simulator that speaks like a recorded robot."""

    drives: int = 200
    """Number of rooms."""
    guarded: int = 200
    """Number of rooms that are driven behind the guard, too."""
    live: int = 20
    """Number of rooms that are driven in the live graph, too."""
    world: str = "dense"
    """The kind of rooms."""
    policy: str = "ppo-rooms"
    """The policy."""
    speaks_as: str = "turtlebot3"
    """The recorded robot."""
    safety_margin: float = 0.08
    """Clearance that the policy keeps behind the guard, m: as on a robot."""
    workers: int = 2
    """Number of graphs that run at the same time."""
    kept: Path = Path("out/as_robot")
    """Folder for finished drives."""


class Guarded(TurtlebotSimulator):
    """A simulated robot with a guard, whose collision monitor has the last word on each command."""

    driven: ClassVar[Guarded]
    """The robot of the newest graph."""

    def __init__(self, params: TurtlebotSimulator.Params) -> None:
        super().__init__(params)
        Guarded.driven = self
        self._parameters = Parameters(robot=params.robot, collision_monitor=True)
        self._begin()

    def _begin(self) -> None:
        self._arbiter, self._steps, self._executed = Arbiter(self._parameters, 0.0), 0, STOP
        self.verdicts = deque[str](maxlen=round(LAST / self.trigger.period))
        """What the monitor said last; empty where it let the command pass."""

    def reset(self) -> None:
        super().reset()
        self._begin()

    def step(self, dt: float, command: Command | None) -> dict[str, Any]:
        """Execute what the guard makes of the command over a control interval: the mean of its decisions."""
        period = self.trigger.period
        times, executed = (self._steps + np.arange(0.0, 1.0, GUARD / period)) * period, []
        for at, now in enumerate(times.tolist() if self._steps else ()):
            if command is not None and at == 0:
                self._arbiter.hear("program", command, now)
            self._executed = self._arbiter.step(now) or self._executed
            executed.append(self._executed)
        if self._arbiter.monitor:
            self.verdicts.append(self._arbiter.monitor.state)
        values = super().step(dt, Command(*np.mean(executed, axis=0).tolist()) if executed else command)
        self._steps += 1
        if "scan" in values:
            scan = values["scan"].value if isinstance(values["scan"], Aged) else values["scan"]
            mount = self.outputs["scan"].mount
            frame = mount.frame if mount else ""
            sent = RawScan(scan.ranges, scan.first, scan.increment, scan.range_min, scan.range_max, frame)
            self._arbiter.hear_scan(sent, self._steps * period)
        return values


def load_guarded(name: str) -> Any:
    """Return the code of a node: of the simulator, the guarded one's."""
    return Guarded if name == "turtlebot_simulator" else load(name)


def drive(config: Config, speaks: bool, guarded: bool, live: bool, seed: int) -> dict[str, Any]:
    """Drive a room to its end, and return how it ended."""
    simulator = {"world": config.world, "seed": seed, "speaks_as": config.speaks_as if speaks else "none"}
    margin = config.safety_margin if guarded else 0.0
    controller = {"policy": config.policy, "goal_tolerance": 0.0, "safety_margin": margin}
    ended = in_the_graph(guarded, **simulator, **controller) if live else alone(guarded, simulator, controller)
    verdicts = Counter(Guarded.driven.verdicts) if guarded else Counter[str]()
    return {"speaks": speaks, "guarded": guarded, "live": live, "seed": seed, **ended, "verdicts": dict(verdicts)}


def in_the_graph(guarded: bool, **options: Any) -> dict[str, float]:
    """Drive a room in the live graph."""
    with patch("turtlebot_gym_ros.graph.graph.load", load_guarded if guarded else load), Graph(**options) as graph:
        until, ended = 0.0, {"goal reached": 0.0, "collision": 0.0}
        while until < LONGEST and not (ended["goal reached"] or ended["collision"]):
            until += LOOK
            graph.wait_until(lambda graph, until=until: graph.time >= until, timeout=300.0)
            trajectory = graph.trajectory()
            trajectory = trajectory[: np.searchsorted(trajectory.time, LONGEST + 1e-6)]
            ended = room_metrics(trajectory)
    return ended


def alone(guarded: bool, simulator: dict[str, Any], controller: dict[str, Any]) -> dict[str, float]:
    """Drive a room by the code of the graph's nodes, each step of the simulator followed by those of filter and controller."""
    make = Guarded if guarded else TurtlebotSimulator
    robot = make(make.Params(**simulator, own_clock=False))
    filter_, policy = KalmanFilter(KalmanFilter.Params()), VelocityController(VelocityController.Params(**controller))
    period, command, scan, least = robot.trigger.period, None, Aged(None, 0.0), np.inf
    mount = robot.outputs["scan"].mount
    seen_from, there, touches, at = mount and Pose(mount.x, mount.y, mount.yaw), False, False, 0
    for at in range(round(LONGEST / period) + 1):
        values = {
            name: value if isinstance(value, Aged) else Aged(value, 0.0) for name, value in robot.step(period, command).items()
        }
        goal, clearance = values["goal"].value, values["clearance"].value.distance
        least, there, touches = min(least, clearance), arrived(values["truth"].value, goal, ROOM), clearance < 0.0
        if at and (there or touches):
            break
        scan = values.get("scan", scan._replace(age=scan.age + period))._replace(mount=seen_from)
        believed = filter_.step(period if at else 0.0, values["odometry"].value)
        if believed and at % round(policy.trigger.period / period) == 0:
            dt = policy.trigger.period
            command = policy.step(dt, believed["estimate"], goal, None, scan, believed["nis"]).get("command", command)
    ended = {"goal reached": there and not touches, "collision": touches, "end of the episode": at * period}
    return {name: float(value) for name, value in {**ended, "least clearance": least}.items()}


def enter(numbers: Any) -> None:
    """Give a worker a ROS domain of its own."""
    os.environ["ROS_DOMAIN_ID"] = str(DOMAIN + numbers.get())
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"


def drives(config: Config) -> list[dict[str, Any]]:
    """Return all drives; those of an earlier run of the same commit are not driven again."""
    file = f"{provenance()['commit']}-{config.speaks_as}-{config.policy}-{config.world}-{config.safety_margin}.jsonl"
    number = {False: config.drives, True: config.guarded}
    wanted = [(*arm, False, seed) for arm in ARMS for seed in range(FIRST, FIRST + number[arm[1]])]
    wanted += [(speaks, guarded, True, seed) for speaks, guarded, _, seed in wanted if seed < FIRST + config.live]
    spawn = multiprocessing.get_context("spawn")
    numbers = spawn.Queue()
    for worker in range(config.workers):
        numbers.put(worker)
    with ProcessPoolExecutor(config.workers, spawn, enter, (numbers,)) as pool:
        ended = finished(partial(drive, config), wanted, config.kept / file, ("speaks", "guarded", "live", "seed"), pool)
        return list(each(ended, "drives", len(wanted)))


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the shares of successes and contacts in each arm, and the differences between plain and imitated messages."""
    rows = sorted(rows, key=lambda row: row["seed"])
    without = {(row["speaks"], row["guarded"], row["seed"]): row for row in rows if not row["live"]}
    by_arm = {arm: [row for row in without.values() if (row["speaks"], row["guarded"]) == arm] for arm in ARMS}
    live = [row for row in rows if row["live"]]
    same = [
        np.allclose([row[key] for key in ENDS], [without[row["speaks"], row["guarded"], row["seed"]][key] for key in ENDS])
        for row in live
    ]
    result: dict[str, Any] = {"live": {"drives": len(live), "same end": sum(same)}}
    for guarded in sorted({guarded for speaks, guarded in by_arm if by_arm[speaks, guarded]}):
        events = {}
        for speaks in (False, True):
            arm = by_arm[speaks, guarded]
            events[speaks] = np.array([row["goal reached"] for row in arm])
            contacts = np.array([row["collision"] for row in arm])
            lost = [
                {key: row[key] for key in ("seed", "collision", "end of the episode", "verdicts")}
                for row in arm
                if not row["goal reached"]
            ]
            name = f"{'robot' if speaks else 'plain'}, {'monitor' if guarded else 'bare'}"
            result[name] = {
                "drives": len(arm),
                "success": share(events[speaks])._asdict(),
                "contacts": int(contacts.sum()),
                "least clearance": min((row["least clearance"] for row in arm), default=None),
                "lost": lost,
            }
        difference = paired_share_difference(events[True], events[False])
        result[f"difference, {'monitor' if guarded else 'bare'}"] = difference._asdict()
    return result


def measure(config: Config) -> tuple[dict[str, Any], list[Table]]:
    """Drive, and return the shares of successes and contacts, and their table."""
    result = summary(drives(config))
    table = Table("messages, guard", "success, %", "contacts", "least clearance, m", title=f"{config.policy} in {config.world}")
    print("In the live graph: {drives} drives, of which {same end} ended as without it.".format_map(result["live"]))
    for name, arm in list(result.items())[1:]:
        interval = Interval(**(arm.get("success") or arm))
        cells = (str(arm["contacts"]), f"{arm['least clearance']:.3f}") if "contacts" in arm else ()
        table.add_row(name, f"{interval:.1%}", *cells)
    return result, [table]


if __name__ == "__main__":
    run(Config, measure)
