"""The chain of nodes on a robot, as `robot.launch.xml` starts them: real processes, which a fault suspends, kills or hangs up.

Processes are found by a mark in their environment, not by who started them, so that one which forks or leaves its session
stays known, and is ended at last.
"""

from __future__ import annotations

import os
import pty
import shlex
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from signal import Signals
from typing import IO, Any

CONFIG = Path(__file__).parents[1] / "bridges" / "turtlebot_gym_ros" / "config" / "robot.yaml"
GUARD, STANDBY, FILTER, CONTROLLER = "cmd_vel_guard", "cmd_vel_standby", "kalman_filter", "velocity_controller"
CHAIN = {
    GUARD: {"collision_monitor": "true"},
    STANDBY: {},
    FILTER: {"takes_fixes": "true"},
    "waypoint_generator": {"waypoints": "far.yaml"},
    CONTROLLER: {},
}
"""The nodes, each with its parameters besides those of `robot.yaml`."""
WITHOUT_BUTTON, MARK = {"require_emergency_stop": "false", "start_enabled": "true"}, "TURTLEBOT_GYM_FAULTS"
"""Parameters of a guard without a button: one that is started again passes commands at once, unlike on a robot; a variable."""


class Chain:
    """The processes of one robot in its ROS domain, which may have emergency stops."""

    def __init__(self, domain: int, *, buttons: bool) -> None:
        self._folder = tempfile.TemporaryDirectory()
        self.folder = Path(self._folder.name)  # they run there, and write NAME.log
        (self.folder / "far.yaml").write_text("[[1000, 0, 0]]\n")
        self._buttons, self._mark = buttons, f"{os.getpid()}-{domain}"
        self._environment = {**os.environ, "ROS_DOMAIN_ID": str(domain), MARK: self._mark}
        self._children: list[subprocess.Popen[bytes]] = []
        self._ended, self._changed = set[str](), set[str]()

    def start(self, name: str, *words: str, environment: Mapping[str, str] = {}, **parameters: str) -> None:
        """Start a node, with further ROS arguments, variables and parameters."""
        self._ended.discard(name)
        program = ["setpriv", "--pdeathsig", "KILL", *self._command(name, *words, **parameters)]
        with (self.folder / f"{name}.log").open("ab") as log:
            given = {"cwd": self.folder, "env": {**self._environment, **environment}, "stdout": log, "stderr": log}
            self._children.append(subprocess.Popen(program, **given))

    def restart(self, name: str, *words: str, **given: Any) -> None:
        """End a node and start it otherwise; it is started as usual before the next fault."""
        self.end(name)
        self.start(name, *words, **given)
        self._changed.add(name)

    def _command(self, name: str, *words: str, **parameters: str) -> list[str]:
        without = WITHOUT_BUTTON if name == GUARD and not self._buttons else {}
        values = [word for key, value in {**CHAIN[name], **without, **parameters}.items() for word in ("-p", f"{key}:={value}")]
        remapped = ["-r", "cmd_vel:=cmd_vel_in"] if name == CONTROLLER else []
        common = ["--ros-args", "--params-file", str(CONFIG), "--log-level", "fatal"]
        package = "cmd_vel_guard" if name in (GUARD, STANDBY) else "turtlebot_gym_ros"
        return [sys.executable, "-m", package, name, *common, *values, *remapped, *words]

    @contextmanager
    def terminal(self) -> Iterator[IO[bytes]]:
        """Start guard and standby again in a terminal, as one job of its shell, and yield its keyboard, which closes it."""
        for name in (GUARD, STANDBY):
            self.end(name)
        self._ended -= {GUARD, STANDBY}
        self._changed |= {GUARD, STANDBY}
        jobs = " & ".join(f"{shlex.join(self._command(name))} >>terminal.log 2>&1" for name in (GUARD, STANDBY))
        # With job control the job has a process group of its own, which the keyboard's signals reach; without it a session's
        # only group is an orphan, which cannot be suspended. Under nohup all of them would ignore hang-ups.
        program = ["setsid", "--ctty", "env", "--default-signal", "bash", "-m", "-c", f"({jobs} & wait); sleep 1000"]
        master, screen = pty.openpty()
        ends = {"stdin": screen, "stdout": screen, "stderr": screen}
        self._children.append(subprocess.Popen(program, cwd=self.folder, env=self._environment, **ends))
        os.close(screen)
        try:
            with open(master, "wb", buffering=0) as keyboard:
                yield keyboard
        finally:
            for name in (GUARD, STANDBY):
                self.kill(name)

    def pids(self, name: str = "") -> list[int]:
        """Return the processes of a node that live; without a name all of this chain."""
        for child in self._children:
            child.poll()  # a dead one is a process until somebody asks
        mark, found = f"{MARK}={self._mark}".encode(), []
        for path in Path("/proc").iterdir():
            with suppress(OSError, ValueError):
                words = (path / "cmdline").read_bytes().split(b"\0")
                is_it = not name or words[3:4] == [name.encode()]  # of python -m PACKAGE NAME
                if is_it and mark in (path / "environ").read_bytes().split(b"\0"):
                    found.append(int(path.name))
        return found

    def signal(self, name: str, what: str) -> float:
        """Send a signal, such as "STOP", to a node, and return when, s; with one that ends it, its end is no failure."""
        if what not in ("STOP", "CONT"):
            self._ended.add(name)
        pids, at = self.pids(name), time.time()
        for pid in pids:
            with suppress(ProcessLookupError):
                os.kill(pid, Signals[f"SIG{what}"])
        return at

    def kill(self, name: str = "") -> None:
        """Kill a node, by default the whole chain, and wait for its end."""
        self._ended.add(name)
        while self.pids(name):
            self.signal(name, "KILL")
            time.sleep(0.01)

    def end(self, name: str) -> None:
        """End a node as a person does, and kill it after 2 s: one that is killed counts as a publisher for 20 s."""
        self.signal(name, "INT")
        until = time.monotonic() + 2.0
        while self.pids(name) and time.monotonic() < until:
            time.sleep(0.02)
        self.kill(name)

    def dead(self) -> list[str]:
        """Return the nodes that have ended though nobody ended them."""
        return [name for name in CHAIN if name not in self._ended and not self.pids(name)]

    def refuses(self, name: str) -> bool:
        """Return whether a node that was started has ended because it refuses its arguments, which is no failure."""
        if not self.pids(name) and "error: " in (self.folder / f"{name}.log").read_text(encoding="utf-8"):
            self._ended.add(name)
        return name in self._ended

    def repair(self) -> None:
        """Let all nodes run as usual."""
        for name in CHAIN:
            self.signal(name, "CONT")
            if name in self._changed:
                self.end(name)
            if not self.pids(name):
                self.start(name)
        self._changed.clear()

    def close(self) -> None:
        """End all processes."""
        self.kill()
        for child in self._children:
            child.wait()
        self._folder.cleanup()
