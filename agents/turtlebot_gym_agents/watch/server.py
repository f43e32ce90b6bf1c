"""Serve drives to a browser: complete ones, and those that grow while they are watched.

The page and all its resources come from this server; by default it listens on this machine only.
"""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Sequence
from contextlib import suppress
from threading import Event, Thread
from types import TracebackType
from typing import Any

from bokeh.application import Application
from bokeh.application.handlers import FunctionHandler
from bokeh.document import Document
from bokeh.server.server import Server as BokehServer

from turtlebot_gym_agents.watch.track import Growing, Track
from turtlebot_gym_agents.watch.view import View, fill

LOCAL = ("localhost", "127.0.0.1")
"""Names of this machine that only it can reach."""
EVERYWHERE = ("", "0.0.0.0")
"""Wildcard addresses."""
PERIOD_MS = 150
"""Time between two checks for new pieces."""


class Server:
    """A server that runs in its own thread until its ``with`` block ends.

    Each browser has its own view and scrubs independently.

    Args:
        drives: The drives to show; each has rows.
        title: Title of the page.
        live: Whether the drives grow.
        host: Name or address to listen on; with any but a loopback address, other machines can see the view.
        port: Port to listen on; 0 for any free port.

    Raises:
        ValueError: If the port is out of range.
        OSError: If the port is taken or the address is not this machine's.
    """

    def __init__(self, drives: Sequence[Growing], *, title: str, live: bool, host: str = "localhost", port: int = 5006) -> None:
        if not 0 <= port < 2**16:
            raise ValueError(f"port must be from 0 to {2**16 - 1}, got {port!r}.")
        self._drives, self._title, self._live, self._host, self._port = drives, title, live, host, port
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
        """URL of the view."""
        return f"http://{socket.gethostname() if self._host in EVERYWHERE else self._host}:{self._port}/"

    def _run(self) -> None:
        self._loop = loop = asyncio.new_event_loop()
        asyncio.set_event_loop(loop)
        server = None
        try:
            self._port = _free_port(self._host, self._port)
            server = BokehServer(
                {"/": Application(FunctionHandler(self._show))},
                address=self._host,
                port=self._port,
                allow_websocket_origin=self._origins(),
            )
            server.start()
        except BaseException as error:  # raised again at the start of the block
            self._error = _explained(error, self._host, self._port)
        self._ready.set()
        if server is not None and self._error is None:
            loop.run_forever()
            loop.run_until_complete(_end(server))
        loop.close()

    def _origins(self) -> list[str]:
        """Return the origins from which a browser may connect: this server's own pages."""
        if self._host in EVERYWHERE:
            return ["*"]  # it has as many names as the machine
        return [f"{name}:{self._port}" for name in {self._host, *(LOCAL if self._host in LOCAL else ())}]

    def _show(self, document: Document) -> None:
        """Fill a browser's document, and keep it updated."""
        read = [drive.read() for drive in self._drives]
        tracks = [track for _, track, _ in read if track is not None]
        view = fill(document, tracks, title=self._title, live=self._live)
        if self._live:
            seen = [(number, pieces) for number, _, pieces in read]
            document.add_periodic_callback(lambda: _follow(self._drives, view, seen), PERIOD_MS)


def serve(tracks: Sequence[Track], *, title: str, host: str = "localhost", port: int = 5006) -> None:
    """Serve complete drives, print the URL, and return when the process is interrupted (Ctrl-C)."""
    with Server([Growing(track) for track in tracks], title=title, live=False, host=host, port=port) as server:
        wait(server)


def wait(server: Server) -> None:
    """Print the URL of a view, and return when the process is interrupted."""
    print(f"{server.url}  (Ctrl-C ends)", flush=True)
    with suppress(KeyboardInterrupt):
        Event().wait()


def _follow(drives: Sequence[Growing], view: View, seen: list[tuple[int, int]]) -> None:
    """Send new pieces to one browser, or reload its page if another drive has begun.

    Args:
        drives: The drives shown.
        view: The view in this browser.
        seen: Number of each drive, and how many of its pieces the view has; updated in place.
    """
    for at, (drive, run) in enumerate(zip(drives, view.runs, strict=True)):
        number, track, pieces = drive.read(*seen[at])
        if number != seen[at][0]:
            view.reload()
        elif track is not None:
            run.add(track)
        seen[at] = number, pieces


async def _end(server: BokehServer) -> None:
    """Stop listening and close all connections."""
    server.stop()
    server.unlisten()
    await asyncio.sleep(0.05)  # time for the connections to close
    rest = asyncio.all_tasks() - {asyncio.current_task()}
    for task in rest:
        task.cancel()
    await asyncio.gather(*rest, return_exceptions=True)


def _free_port(host: str, port: int) -> int:
    """Return a port, or for 0 any free one.

    Raises:
        OSError: If the port is taken, or the address is not this machine's.
    """
    with socket.create_server((host, port)) as free:
        return int(free.getsockname()[1])


def _explained(error: BaseException, host: str, port: int) -> BaseException:
    """Return an error that says what to do if a server cannot listen."""
    if not isinstance(error, OSError):
        return error
    why = error.strerror or error
    return OSError(f"cannot listen on {host}, port {port}: {why}. Choose another one with --port, or 0 for any.")
