"""Serve drives to a browser: complete ones, and those that grow while they are watched.

The page and all its resources come from this server; by default it listens on this machine only.
"""

from __future__ import annotations

import asyncio
import ipaddress
import socket
from collections.abc import Sequence
from contextlib import suppress
from threading import Event, Thread
from types import TracebackType
from typing import Any

from bokeh.application import Application
from bokeh.application.handlers import FunctionHandler
from bokeh.document import Document
from bokeh.server.server import BaseServer
from bokeh.server.tornado import BokehTornado
from bokeh.server.util import bind_sockets
from tornado.httpserver import HTTPServer
from tornado.httputil import HTTPServerRequest
from tornado.ioloop import IOLoop
from tornado.routing import Matcher, Rule, RuleRouter

from turtlebot_gym.drive import Drive
from turtlebot_gym.validation import as_int
from turtlebot_gym_view.buffer import DriveBuffer
from turtlebot_gym_view.view import View, fill

EVERYWHERE = ("", "0.0.0.0")
"""Wildcard addresses."""
PERIOD_MS = 150
"""Time between two checks for new pieces."""


class _OfThisServer(Matcher):
    """Matches requests to a name of this server, from its own pages.

    A page elsewhere whose name is rebound to this machine (DNS rebinding) sends its own name; an address cannot be rebound.
    """

    def __init__(self, host: str) -> None:
        name = socket.gethostname()
        self._names = {host, "localhost", name, f"{name}.local"}

    def match(self, request: HTTPServerRequest) -> dict[str, Any] | None:
        """Return no arguments for a request that is served, and None for others."""
        origin = request.headers.get("Origin")
        same_origin = origin is None or origin.rpartition("//")[2] == request.host
        return {} if same_origin and (request.host_name in self._names or _is_address(request.host_name)) else None


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name.strip("[]"))
    except ValueError:
        return False
    return True


class Server:
    """A server that runs in its own thread until its ``with`` block ends.

    Each browser has its own view and scrubs independently.

    Args:
        drives: The drives to show; each has rows.
        title: Title of the page.
        live: Whether the drives grow.
        side_by_side: Whether each drive has a map of its own.
        host: Name or address to listen on; with any but a loopback address, other machines can see the view.
        port: Port to listen on; 0 for any free port.

    Raises:
        ValueError: If the port is out of range.
        OSError: If the port is taken or the address is not this machine's.
    """

    def __init__(
        self,
        drives: Sequence[DriveBuffer],
        *,
        title: str,
        live: bool,
        side_by_side: bool = False,
        host: str = "localhost",
        port: int = 5006,
    ) -> None:
        as_int("port", port, 0, 2**16 - 1)
        self._drives, self._title, self._live, self._host, self._port = drives, title, live, host, port
        self._side_by_side = side_by_side
        self._ready = Event()
        self._error: BaseException | None = None
        self._loop: Any = None
        self._thread = Thread(target=self._run, name="watch", daemon=True)

    def __enter__(self) -> Server:  # noqa: PYI034  # typing.Self needs Python 3.11
        self._thread.start()
        self._ready.wait()
        if self._error is not None:
            raise self._error
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._loop is not None:
            self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(5.0)

    @property
    def url(self) -> str:
        return f"http://{socket.gethostname() if self._host in EVERYWHERE else self._host}:{self._port}/"

    def _run(self) -> None:
        self._loop = loop = asyncio.new_event_loop()
        asyncio.set_event_loop(loop)
        server = None
        try:
            with socket.create_server((self._host, self._port)) as free:  # raises where it cannot listen, without a leak
                self._port = int(free.getsockname()[1])
            sockets, _ = bind_sockets(self._host, self._port)
            pages = BokehTornado({"/": Application(FunctionHandler(self._show))}, extra_websocket_origins=["*"])
            http = HTTPServer(RuleRouter([Rule(_OfThisServer(self._host), pages)]))  # the rule checks origins instead
            http.add_sockets(sockets)
            server = BaseServer(IOLoop.current(), pages, http)
            server.start()
        except BaseException as error:  # raised again at the start of the block
            self._error = _explained(error, self._host, self._port)
        self._ready.set()
        if server is not None and self._error is None:
            loop.run_forever()
            loop.run_until_complete(_end(server))
        loop.close()

    def _show(self, document: Document) -> None:
        """Fill a browser's document, and keep it updated."""
        read = [drive.read() for drive in self._drives]
        drives = [drive for _, drive, _ in read if drive is not None]
        view = fill(document, drives, title=self._title, live=self._live, side_by_side=self._side_by_side)
        if self._live:
            seen = [(number, pieces) for number, _, pieces in read]
            document.add_periodic_callback(lambda: _follow(self._drives, view, seen), PERIOD_MS)


def serve(
    drives: Sequence[Drive], *, title: str, side_by_side: bool = False, host: str = "localhost", port: int = 5006
) -> None:
    """Serve complete drives, print the URL, and return when the process is interrupted (Ctrl-C)."""
    buffers = [DriveBuffer(drive) for drive in drives]
    with Server(buffers, title=title, live=False, side_by_side=side_by_side, host=host, port=port) as server:
        print(f"{server.url}  (Ctrl-C ends)", flush=True)
        with suppress(KeyboardInterrupt):
            Event().wait()


def _follow(drives: Sequence[DriveBuffer], view: View, seen: list[tuple[int, int]]) -> None:
    """Send new pieces to one browser, or reload its page if another drive has begun.

    ``seen`` holds the number of each drive and how many of its pieces the view has; it is updated.
    """
    for at, (drive, run) in enumerate(zip(drives, view.runs, strict=True)):
        number, piece, pieces = drive.read(*seen[at])
        if number != seen[at][0]:
            view.reload()
        elif piece is not None:
            run.add(piece)
        seen[at] = number, pieces


async def _end(server: BaseServer) -> None:
    """Stop listening and close all connections."""
    server.stop()
    server.unlisten()
    await asyncio.sleep(0.05)  # time for the connections to close
    tasks = asyncio.all_tasks() - {asyncio.current_task()}
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


def _explained(error: BaseException, host: str, port: int) -> BaseException:
    """Return an error that says what to do if a server cannot listen."""
    if not isinstance(error, OSError):
        return error
    why = error.strerror or error
    return OSError(f"cannot listen on {host}, port {port}: {why}. Choose another one with --port, or 0 for any.")
