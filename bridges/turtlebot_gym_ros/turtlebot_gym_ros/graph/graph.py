"""Run the closed loop as a live graph from Python: in this process, or with one process per node."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from threading import Event
from typing import Any

from std_srvs.srv import SetBool

from cmd_vel_guard.process import SETTLE, Runner
from turtlebot_gym.config import choose
from turtlebot_gym.drive import Drive
from turtlebot_gym.observations import EVIDENCE, SCAN, TRACKS
from turtlebot_gym.rooms.worlds import find_lidar
from turtlebot_gym_agents.policies import make_policy, terms_of
from turtlebot_gym_agents.policies.fit import OPEN, require_task
from turtlebot_gym_ros.base.executor import FastExecutor
from turtlebot_gym_ros.base.frames import Common
from turtlebot_gym_ros.base.names import absolute, prefix_of
from turtlebot_gym_ros.base.process import go_on, processes
from turtlebot_gym_ros.blocks import TurtlebotSimulator, VelocityController
from turtlebot_gym_ros.blocks.simulator import NO_FIX, OPEN_GROUND
from turtlebot_gym_ros.graph.recorder import GraphRecorder
from turtlebot_gym_ros.node.shell import Shell
from turtlebot_gym_ros.nodes import MODES, load

OWN_CLOCK = ("-r", "/clock:=clock")
"""Remapping of /clock, to which rclpy listens regardless of the namespace, so that each graph has its own."""
LOCALIZED = {"frame": "map", "odom_frame": "odom", "hits": False, "start": "odometry", "when_lost": "drive", "noise": "wheel"}
"""Parameters of a graph with a localizer: as in the environment, it knows its start and the obstacles, and always answers."""
SQUARE = "turtlebot_gym/TurtleBotSquare-v0"
"""The task of a graph without a world or waypoints."""
PATIENCE = 60.0
"""Longest wait for the graph to start, s."""


class Graph:
    """A running graph, which ends with its ``with`` block; in a notebook, call `start` and `close` in separate cells.

        with Graph(policy="bearing") as graph:
            graph.wait_until(lambda graph: graph.state == "silent: done")
            trajectory = graph.trajectory()

    Once it is started, all nodes have found each other, and in autonomous mode the robot is at the start and enabled.

    It runs on simulated time in lock-step: each step waits for its command, so that the drive is bit-identical to the
    environment's with the same seed, on any machine. A person's commands belong to no step, so teleoperation runs in real time.

    With a ``world`` the simulator is in a room, and the waypoint is the room's goal; with ``goals`` it gives several in turn.
    With a ``localizer`` the estimate is the localizer's, in the frame ``map``, instead of the filter's.

    Args:
        mode: "autonomous" or "teleoperation".
        processes: Whether each node runs in a process of its own.
        real_time: Whether it runs in real time, as on a robot.
        namespace: Namespace of all nodes and topics, such as "robot1", so that several robots can share one ROS domain.
        frame_prefix: Prefix of all frames; None for that of the namespace, "robot1/".
        allow_mismatch: Whether a policy that was made for another task may drive.
        parameters: Parameters by name; each goes to the nodes that have one of that name.

    Raises:
        ValueError: If a node refuses its parameters, no node has one of them, or lock-step is combined with an unstamped Twist.
        TimeoutError: If the graph does not start.
    """

    def __init__(
        self,
        *,
        mode: str = "autonomous",
        processes: bool = False,
        real_time: bool = False,
        namespace: str = "",
        frame_prefix: str | None = None,
        allow_mismatch: bool = False,
        **parameters: Any,
    ) -> None:
        self._namespace = absolute(namespace)
        parameters = {"frame_prefix": prefix_of(namespace) if frame_prefix is None else frame_prefix, **parameters}
        self._names = choose("mode", mode, MODES)
        if parameters.get("localizer") is not None:
            self._names = tuple("localizer" if name == "kalman_filter" else name for name in self._names)
            parameters = {**LOCALIZED, **parameters}
        else:
            parameters.pop("localizer", None)
        self.latest: Mapping[str, Any] = {}
        """The last value of each topic: "true_state", "odom", "estimate", "reference", "cmd_vel"; in a world also "clearance"
        and "obstacles", and on a map "map"."""
        self.reports: Mapping[str, tuple[int, str]] = {}
        """Level and message of each node's diagnostics."""
        self._processes: list[subprocess.Popen[bytes]] = []
        self._ending, self._failed = ExitStack(), Event()
        self._in_processes = processes
        self._autonomous = mode == "autonomous"
        self._lock_step = self._autonomous and not real_time
        if self._autonomous:
            parameters = _fit_room(parameters, allow_mismatch=allow_mismatch)
        if "tick" in parameters:  # the tracker's parameter, which a policy that reads its tracks brings
            self._names = (*self._names, "people_tracker")
        if parameters.get("fix", "none") not in NO_FIX:
            parameters = {"takes_fixes": True, **parameters}
        common = {"enable_stamped_cmd_vel", "frame", "body_frame", "frame_prefix"}
        known = {name: common | load(name).Params.__dataclass_fields__.keys() for name in self._names}
        given = {name: {key: parameters[key] for key in parameters.keys() & known[name]} for name in self._names}
        self._parameters = {name: {"lock_step": self._lock_step, **chosen} for name, chosen in given.items()}
        if unknown := set(parameters).difference(*known.values()):
            raise ValueError(f"no node of mode {mode!r} has a parameter {', '.join(sorted(unknown))}.")
        self._in_room = parameters.get("world", "open") not in OPEN_GROUND
        self._stamped = bool(parameters.get("enable_stamped_cmd_vel", True))
        Common(lock_step=self._lock_step, enable_stamped_cmd_vel=self._stamped)

    def __enter__(self) -> Graph:  # noqa: PYI034  # typing.Self needs Python 3.11
        return self.start()

    def __exit__(self, *exception: object) -> None:
        self.close()

    def start(self) -> Graph:
        """Start all nodes and return the graph when it is running; end it with `close`, as ``with`` does."""
        self._runner = Runner(executor=FastExecutor)
        self._runner.failed = self._failed.set
        try:
            options: Any = {"stamped": self._stamped, "lock_step": self._lock_step, "room": self._in_room}
            self._recorder = GraphRecorder(self._runner.context, namespace=self._namespace, **options)
            self._runner.add(self._recorder)
            self.latest, self.reports = self._recorder.latest, self._recorder.reports
            if self._in_processes:  # the command line cannot express empty text
                nodes = [(name, {k: v for k, v in self._parameters[name].items() if v != ""}) for name in self._names]
                words = [*OWN_CLOCK, "-r", f"__ns:={self._namespace}"]
                self._processes = self._ending.enter_context(processes(nodes, words))
            else:
                where: Any = {"namespace": self._namespace, "context": self._runner.context, "arguments": OWN_CLOCK}
                for name in self._names:
                    block = load(name)
                    self._runner.add(Shell(block, block.Params, name=name, overrides=self._parameters[name], **where))
            self._runner.start()
            self._come_up()
        except BaseException:
            self.close()
            raise
        return self

    def _come_up(self) -> None:
        """Wait for all nodes and enable the controller: until then the robot stands, and in lock-step time does."""
        topics = ("true_state", "estimate", "reference") if self._autonomous else ("true_state", "estimate")
        self._wait(lambda graph: all(topic in graph.latest for topic in topics))
        if not self._lock_step:
            self._recorder.restart()
        if self._autonomous:
            self._wait(lambda graph: graph._recorder.is_connected)
            client = self._recorder.node.create_client(SetBool, "velocity_controller/enable")
            self._wait(lambda graph: client.service_is_ready())
            answer = client.call_async(SetBool.Request(data=True))
            self._wait(lambda graph: answer.done())
        self._wait(lambda graph: graph._recorder.has_begun)

    def _wait(self, condition: Callable[[Graph], Any]) -> None:
        self.wait_until(lambda graph: not graph.require_no_fault() and condition(graph), timeout=PATIENCE)

    @property
    def state(self) -> str:
        """The controller's state: "active", or "silent" or "stopping" with the reason."""
        return self._recorder.state

    def require_no_fault(self) -> None:
        """Raise `RuntimeError` if a node reports that its step failed."""
        reports = {name: text for name, (_, text) in dict(self.reports).items()}
        for name, text in (("velocity_controller", self.state), *reports.items()):
            if "fault: " in text:
                raise RuntimeError(f"{name} is {text}" if text == self.state else f"{name} reports {text}")

    @property
    def time(self) -> float:
        """Time since the start by the stamps, s."""
        return self._recorder.time

    def trajectory(self) -> Drive:
        """Return the drive so far."""
        return self._recorder.trajectory()

    def wait_until(self, condition: Callable[[Graph], Any], *, timeout: float | None = 60.0) -> None:
        """Wait until a function of this graph is true, at most for ``timeout``, s; None waits indefinitely.

        Raises:
            TimeoutError: If it is not true in time; the message has each node's report.
            RuntimeError: If a node's process, or the thread of the nodes, has ended.
        """
        deadline = None if timeout is None else time.monotonic() + timeout
        while not condition(self):
            go_on()
            if self._failed.is_set():
                raise RuntimeError("the thread of the nodes has ended with an error.")
            for process in self._processes:
                if process.poll() is not None:
                    raise RuntimeError(f"{process.args[3]} ended with exit code {process.returncode}.")  # type: ignore[index]
            if deadline is not None and time.monotonic() > deadline:
                raise TimeoutError(f"The condition did not hold within {timeout} s; the nodes report {dict(self.reports)}.")
            time.sleep(0.01)

    def close(self) -> None:
        """End all nodes; the robot is stopped first."""
        self._ending.close()
        if self._processes:
            time.sleep(SETTLE)  # until their departure has been announced, see the guard's `process`
        self._processes = []
        self._runner.close()


def _fit_room(parameters: Mapping[str, Any], *, allow_mismatch: bool = False) -> dict[str, Any]:
    """Return the parameters of a graph, with defaults by its world; raise `ValueError` if the policy does not fit."""
    world, name = parameters.get("world", "open"), parameters.get("policy", VelocityController.Params().policy)
    policy = make_policy(name, robot=parameters.get("robot", "burger"), dt=parameters.get("period", 0.1))
    names = {term.name for term in terms_of(policy) or ()}
    if SCAN.name in names and world in OPEN_GROUND:
        raise ValueError(f"policy {name!r} sees by LiDAR, and needs a world.")
    card: Any = getattr(policy, "card", None)
    if card is not None and card.env in OPEN and world not in OPEN_GROUND:
        raise ValueError(f"policy {name!r} was made for open ground, not for a world.")
    if EVIDENCE.name in names and parameters.get("localizer") is None:
        raise ValueError(f"policy {name!r} was trained with a localizer: choose one.")
    if world in OPEN_GROUND and parameters.get("waypoints", "square") == "square" and not allow_mismatch:
        require_task(policy, name, SQUARE, "ekf")
    if world in OPEN_GROUND:
        return dict(parameters)
    lidar = find_lidar(parameters.get("lidar", TurtlebotSimulator.Params().lidar))
    if TRACKS.name in names:  # a person of the simulation moves once in each of its steps
        parameters = {"tick": parameters.get("period", 0.1), **parameters}
    return {"waypoints": "room", "lidar_yaw": lidar.yaw, "lidar_beams": lidar.beams, **parameters}
