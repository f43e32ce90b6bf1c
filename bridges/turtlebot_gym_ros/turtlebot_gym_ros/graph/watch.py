"""The live graph in a browser: a listening node, and a server for the view."""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from threading import Event
from typing import Any

from turtlebot_gym.extras import installing
from turtlebot_gym.rooms.lidar import LIDARS
from turtlebot_gym_ros.base.names import absolute
from turtlebot_gym_ros.base.process import Runner, refuse
from turtlebot_gym_ros.blocks import TurtlebotSimulator
from turtlebot_gym_ros.graph.watcher import Watcher


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
            from turtlebot_gym_agents.watch.server import Server
        except ImportError as error:
            raise ImportError(f"{error.name} is not installed: {installing('watch')}.") from error
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
            Event().wait()


def main(argv: Sequence[str] | None = None) -> int:
    """Listen, serve the view until the process is interrupted, and return the exit code."""
    parser = argparse.ArgumentParser(prog="watch", description="Show the running graph in a browser.")
    parser.add_argument("--namespace", default="", help="namespace of the robot, such as robot1")
    parser.add_argument("--lidar", choices=list(LIDARS), default="lds01", help="LiDAR, for its mounting (default lds01)")
    parser.add_argument("--host", default="localhost", help="where to listen (default localhost: this machine only)")
    parser.add_argument("--port", type=int, default=5006, help="port to listen on (default 5006); 0 for any free one")
    options = parser.parse_args(argv)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
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
