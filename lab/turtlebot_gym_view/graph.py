"""The live graph in a browser: an observer that turns its topics into a growing drive, and a server for the view.

The observer only listens, to a simulated graph or a robot's, in real time or in lock-step. A row is a message on ``odom`` with
what the other topics say at its stamp. A leap of the stamps, forwards or backwards, a reset of the plant and another room each
begin another drive.
"""

from __future__ import annotations

import math
import sys
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from importlib.util import find_spec
from threading import Event
from typing import Any

import numpy as np
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Empty

from turtlebot_gym.drive import RoomData
from turtlebot_gym.extras import installing
from turtlebot_gym.rooms.lidar import LIDARS
from turtlebot_gym.rooms.worlds import find_lidar
from turtlebot_gym_lab.drives.alignment import LEAP
from turtlebot_gym_lab.drives.messages import GUARD, TYPES, DriveListener
from turtlebot_gym_ros.base.names import absolute, message_type
from turtlebot_gym_ros.base.options import parser_of
from turtlebot_gym_ros.base.process import Runner, be_interruptible, go_on, refuse
from turtlebot_gym_ros.base.qos import LATCHED, STREAM
from turtlebot_gym_ros.blocks import TurtlebotSimulator
from turtlebot_gym_view.buffer import DriveBuffer

STEP = ("true_state", "estimate", "nis", "tracks")
"""Topics whose values belong to the odometry of the same stamp."""
LONGEST = 18_000
"""Rows after which another drive begins, so that browsers keep up: half an hour at 10 Hz."""
POLL = 0.1
"""Time after which a wait looks for an interruption, s."""
LAG = 5
"""Number of later rows after which it stops waiting for a row's values."""
_QOS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Best effort, which matches publishers of either reliability."""
_OTHER = {"map": LATCHED, "tf_static": LATCHED, "diagnostics": STREAM}
_COMMON = ("diagnostics", "tf_static")
"""Topics that all robots share."""


class Watcher:
    """A node that subscribes to all topics of the loop.

    Args:
        context: The rclpy context.
        namespace: Namespace of the graph.
        lidar: Name in `turtlebot_gym.rooms.lidar.LIDARS`, or a file, for the mounting of the LiDAR.
    """

    def __init__(self, context: Context, *, namespace: str | None = None, lidar: str = "lds01") -> None:
        self.node = Node("watch", context=context, namespace=namespace)
        self.drive = DriveBuffer()
        """The recorded drive."""
        guard = f"{self.node.get_namespace().rstrip('/')}/{GUARD}"
        self.listener = DriveListener(lidar=find_lidar(lidar), guard=guard, live=True)
        """What the topics say."""
        self._begun = Event()
        self._pending: deque[float] = deque()
        self._last, self._first, self._rows = math.inf, 0.0, 0
        self._around = RoomData("live")
        for topic, (kind, *_) in TYPES.items():
            if topic not in ("fix", "twist", "imu") and find_spec(kind.partition("/")[0]):  # PyPI does not have tf2_msgs
                named = f"/{topic}" if topic in _COMMON else topic
                self.node.create_subscription(message_type(kind), named, self._hear(topic), _OTHER.get(topic, _QOS))
        self.node.create_subscription(Empty, "reset", self._hear_reset, STREAM)

    def wait(self) -> None:
        """Wait for the first row."""
        while not self._begun.wait(POLL):
            go_on()

    def _hear(self, topic: str) -> Callable[[Any], None]:
        def hear(message: Any) -> None:
            try:
                newer = self.listener.hear(topic, message, time.monotonic())
            except (ValueError, IndexError):
                return  # the nodes that need the message report what is wrong with it
            if topic == "odom" and newer:
                self._pending.append(self.listener["odom"].times[-1])
            self._finish_rows()

        return hear

    def _hear_reset(self, message: Empty) -> None:
        """Begin another drive with the next row: the plant has placed the robot somewhere else."""
        self._pending.clear()
        self._last = math.inf

    def _finish_rows(self) -> None:
        """Add rows that are complete, or that can no longer become complete, since topics overtake each other."""
        heard = [stream.times for topic in STEP if (stream := self.listener[topic])]
        while self._pending:
            stamp = self._pending[0]
            complete = len(self._pending) > 1 and all(stamp in times for times in heard)
            if not complete and len(self._pending) <= LAG:
                return
            self._pending.popleft()
            self._add(stamp)

    def _add(self, stamp: float) -> None:
        rooms, grids = self.listener["obstacles"].values, self.listener["map"].values
        now, old = RoomData("live", room=rooms[-1] if rooms else None, grid=grids[-1] if grids else None), self._around
        is_new = old.grid is None and now.grid is not None
        is_new |= now.room is not None and (
            old.room is None or (now.room.walls, now.room.boxes) != (old.room.walls, old.room.boxes)
        )
        begins = not 0.0 < stamp - self._last <= LEAP or self._rows >= LONGEST or is_new
        if begins:
            self._first, self._rows, self._last, self._around = stamp, 0, -math.inf, now
        rows = self.listener.rows(np.array([stamp]), after=self._last, held=0.0, around=self._around, start=self._first)
        self._last = stamp
        if begins:
            self.drive.restart(rows)
            self._begun.set()
        else:
            self.drive.add(rows)
        self._rows += 1


class View:
    """A view of a graph, which listens from the start of its ``with`` block and is served after `open`.

    Args:
        given: Parameters of the graph; ``namespace`` and ``lidar`` are used.
        title: Title of the page.
        host: Name or address to listen on.
        port: Port; 0 for any free port.

    Raises:
        ImportError: If Bokeh is missing.
    """

    def __init__(self, given: Mapping[str, Any], *, title: str = "Live", host: str = "localhost", port: int = 5006) -> None:
        try:
            from turtlebot_gym_view.server import Server
        except ImportError as error:
            raise ImportError(f"{error.name} is not installed: {installing('view')}.") from error
        self._runner = Runner()
        lidar = given.get("lidar", TurtlebotSimulator.Params().lidar)
        self.watcher = Watcher(self._runner.context, namespace=absolute(given.get("namespace", "")), lidar=lidar)
        self._runner.add(self.watcher)
        self.server = Server([self.watcher.drive], title=title, live=True, host=host, port=port)
        self._ending = ExitStack()

    def __enter__(self) -> View:  # noqa: PYI034  # typing.Self needs Python 3.11
        self._runner.start()
        self._ending.callback(self._runner.close)
        return self

    def __exit__(self, *exception: object) -> None:
        self._ending.close()

    def open(self) -> None:
        """Wait for the first row, serve the view and print its URL.

        Raises:
            OSError: If the server cannot listen.
        """
        self.watcher.wait()
        self._ending.enter_context(self.server)
        print(f"{self.server.url}  (Ctrl-C ends)", flush=True)

    def stay(self) -> None:
        """Return when the process is interrupted."""
        with suppress(KeyboardInterrupt):
            while True:
                go_on()
                time.sleep(POLL)


def main(argv: Sequence[str] | None = None) -> int:
    """Listen, serve the view until the process is interrupted, and return the exit code."""
    parser = parser_of("watch", "Show the running graph in a browser.")
    parser.add_argument("--namespace", default="", help="namespace of the robot, such as robot1")
    parser.add_argument(
        "--lidar", default="lds01", help=f"LiDAR, for its mounting: {', '.join(LIDARS)}, or FILE.yaml (default: lds01)"
    )
    parser.add_argument("--host", default="localhost", help="where to listen (default: localhost, this machine only)")
    parser.add_argument("--port", type=int, default=5006, help="port to listen on (default: 5006); 0 for any free one")
    options = parser.parse_args(argv)
    be_interruptible()
    try:
        with View({"namespace": options.namespace, "lidar": options.lidar}, host=options.host, port=options.port) as view:
            print(f"waiting for {view.watcher.node.resolve_topic_name('odom')} ...", file=sys.stderr, flush=True)
            view.open()
            view.stay()
    except KeyboardInterrupt:
        return 0
    except (ValueError, OSError, ImportError) as error:
        return refuse(error)
    return 0
