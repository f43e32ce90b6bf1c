"""End or suspend guard and standby in every way while they drive, and measure how long the robot's motion stays in force.

Guard and standby run on real DDS in a shell of a pseudo terminal: its keys, its closing and signals to its foreground group
reach them as on a robot. The system clock of both is set by a preloaded library, `benchmarks/clock_shim.c`, at the moment in
which their sources end or the guard is killed. An independent listener on ``/cmd_vel`` counts. A TurtleBot3 holds its last
command indefinitely, so a motion is in force until a zero arrives, whether or not it is repeated. In every other case the
sources go on commanding. A suspended guard is continued after its sources have ended, and then must move nothing.
"""

from __future__ import annotations

import os
import pty
import shutil
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path
from threading import Thread
from typing import Any

from burger import WORDS

LIMIT = 0.5
"""Longest time for which a motion may stay in force, s."""
WATCHED = 1.6
"""Time for which the wheels are watched after an end, s: longer than the standby sends zeros."""
TRANSPORT = {"FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}
"""As on a robot: a killed process leaves shared memory behind, and others may not hear its successor."""
SPEED = 0.1
"""Speed of the commands, m/s."""
STEPS = (-3600.0, -600.0, -30.0, -2.0, -0.775, 0.775, 2.0, 30.0, 600.0, 3600.0)
"""Steps of the system clock, s."""
PROGRAM = f"{sys.executable} -m turtlebot_gym_ros"
BLIND = " ".join(WORDS)
"""A guard's robot, without scans."""
SCRIPT = f"""
{PROGRAM} cmd_vel_guard --ros-args {BLIND} -p require_standby:=true --log-level fatal & echo $! > guard
{PROGRAM} cmd_vel_standby --ros-args --log-level fatal & echo $! > standby
wait; wait
"""


class Wheels:
    """The listener on ``/cmd_vel``, and the source of commands, which others do not hold up.

    Args:
        domain: ROS domain; None for that of the environment.
    """

    def __init__(self, domain: int | None = None) -> None:
        import rclpy.node
        from geometry_msgs.msg import TwistStamped
        from rclpy.context import Context
        from rclpy.executors import SingleThreadedExecutor

        self.context, self.over = Context(), False
        self.heard: list[tuple[float, bool]] = []
        """Steady time at which each command arrived, s, and whether it is a motion."""
        self.commands = True
        """Whether the program commands."""
        self.context.init([], domain_id=domain)
        self.node = rclpy.node.Node("wheels", context=self.context)
        self.node.create_subscription(TwistStamped, "cmd_vel", self._hear, 1000)
        program = self.node.create_publisher(TwistStamped, "cmd_vel_in", 1)
        command = TwistStamped()
        command.twist.linear.x = SPEED
        self.node.create_timer(0.1, lambda: self.commands and program.publish(command))
        executor = SingleThreadedExecutor(context=self.context)
        executor.add_node(self.node)

        def spin() -> None:
            while not self.over:
                executor.spin_once(timeout_sec=0.05)

        self._thread = Thread(target=spin, daemon=True)
        self._thread.start()

    def _hear(self, message: Any) -> None:
        self.heard.append((time.monotonic(), (message.twist.linear.x, message.twist.angular.z) != (0.0, 0.0)))

    def drive(self, *, commands: bool = True, patience: float = 120.0) -> None:
        """Command, unless others do, until the robot moves and goes on moving."""
        self.commands, until = commands, time.monotonic() + patience
        self.heard.clear()
        while time.monotonic() < until:
            now, heard = time.monotonic(), list(self.heard)
            recent = [moves for at, moves in heard if at > now - 0.5]
            if len(recent) > 3 and all(recent):
                return
            time.sleep(0.02)
        raise RuntimeError("the robot does not drive")

    def in_force(self, since: float) -> float:
        """Return for how long a motion was in force after a time, s: until the zero after which no motion came."""
        heard = list(self.heard)
        last = max((place for place, (_, moves) in enumerate(heard) if moves), default=-1)
        zeros = [at for at, _ in heard[last + 1 :]]
        return max(0.0, (zeros[0] if zeros else time.monotonic()) - since)

    def close(self) -> None:
        """Listen no more."""
        self.over = True
        self._thread.join()
        self.node.destroy_node()
        self.context.shutdown()


class Terminal:
    """A shell with guard and standby in a pseudo terminal.

    Args:
        folder: Where they run.
        script: What the shell runs: it writes the process id of each node to a file of its name.
        variables: Variables of their environment that differ.
    """

    def __init__(self, folder: Path, *, script: str = SCRIPT, **variables: str) -> None:
        self._folder = folder
        self._keys: int | None
        self._keys, there = pty.openpty()
        # Under nohup it would ignore hang-ups, and so would the nodes.
        self.shell = subprocess.Popen(
            ["setsid", "--ctty", "env", "--default-signal", "sh", "-c", script],
            stdin=there,
            stdout=there,
            stderr=there,
            cwd=folder,
            env={**os.environ, **TRANSPORT, **variables},
        )
        os.close(there)

    def press(self, key: bytes) -> None:
        """Press a key."""
        assert self._keys is not None
        os.write(self._keys, key)

    def hang_up(self) -> None:
        """Close the terminal, as its window does."""
        if self._keys is not None:
            os.close(self._keys)
        self._keys = None

    def signal(self, number: int) -> None:
        """Send a signal to the foreground group: the shell and all that it has started."""
        os.killpg(self.shell.pid, number)

    def pid(self, name: str) -> int:
        """Return the process id of a node."""
        return int((self._folder / name).read_text())

    def close(self) -> None:
        """Continue and end all processes; none outlives this one."""
        pids = [self.pid(path.name) for path in self._folder.iterdir() if path.read_text().strip().isdigit()]
        for number in (signal.SIGCONT, signal.SIGKILL):
            for pid in pids:
                with suppress(OSError):  # a pid may be another's by now
                    if b"turtlebot_gym_ros" in Path(f"/proc/{pid}/cmdline").read_bytes():
                        os.kill(pid, number)
        with suppress(ProcessLookupError):
            self.signal(signal.SIGKILL)
        self.shell.wait()
        self.hang_up()


class SystemClock:
    """The system clock of a terminal's processes, which can be set.

    Args:
        folder: Where the library and its file are written.

    Raises:
        FileNotFoundError: If there is no C compiler.
    """

    def __init__(self, folder: Path) -> None:
        library, self._file = folder / "clock_shim.so", folder / "ahead"
        compiler = shutil.which("cc") or shutil.which("gcc")
        if compiler is None:
            raise FileNotFoundError("there is no C compiler")
        source = Path(__file__).parents[2] / "benchmarks" / "clock_shim.c"
        subprocess.run([compiler, "-shared", "-fPIC", "-O2", "-o", library, source, "-ldl", "-lm", "-lpthread"], check=True)
        self._file.write_bytes(struct.pack("d", 0.0))
        self.variables = {"LD_PRELOAD": str(library), "CLOCK_SHIM": str(self._file)}
        """Environment of the processes."""

    def step(self, seconds: float) -> None:
        """Set the clock of all processes ahead of the true one."""
        with self._file.open("r+b") as file:
            file.write(struct.pack("d", seconds))


Way = Callable[[Terminal, Wheels, SystemClock], None]


def _clock(seconds: float, *, kill: bool) -> Way:
    """Return the end in which the clock is set when the sources end, or when the guard is killed."""

    def end(terminal: Terminal, wheels: Wheels, clock: SystemClock) -> None:
        wheels.commands = False
        if kill:
            os.kill(terminal.pid("guard"), signal.SIGKILL)
        clock.step(seconds)

    return end


def _key(key: bytes) -> Way:
    return lambda terminal, wheels, clock: terminal.press(key)


def _group(number: int) -> Way:
    return lambda terminal, wheels, clock: terminal.signal(number)


WAYS: dict[str, Way] = {
    "SIGINT": _key(b"\x03"),
    "SIGQUIT": _key(b"\x1c"),
    "SIGTSTP": _key(b"\x1a"),
    "SIGTERM": _group(signal.SIGTERM),
    "SIGHUP": _group(signal.SIGHUP),
    "SIGKILL": _group(signal.SIGKILL),
    "closed": lambda terminal, wheels, clock: terminal.hang_up(),
    **{f"clock {step:+g} s": _clock(step, kill=False) for step in STEPS},
    **{f"clock {step:+g} s, guard killed": _clock(step, kill=True) for step in STEPS},
}
"""Ways to end or suspend guard and standby; signals are those of the foreground group."""
SUSPENDS = ("SIGTSTP",)


def end(
    way: str, wheels: Wheels, folder: Path, *, clock: SystemClock, wait: float, commands: bool, script: str = SCRIPT
) -> dict[str, Any]:
    """End a new guard and its standby while they drive.

    Args:
        way: A name in `WAYS`.
        wheels: The robot.
        folder: Where they run, in a new folder.
        clock: Their clock, which is set back to the true time first.
        wait: Time for which they drive, s.
        commands: Whether the sources go on commanding, unless the clock is set.
        script: What starts them.

    Returns:
        The way; the time for which the motion was in force, s; and whether a process outlived its end.
    """
    (folder / "run").mkdir()
    clock.step(0.0)
    variables = clock.variables if way.startswith("clock") else {}
    with closing(Terminal(folder / "run", script=script, **variables)) as terminal:
        wheels.drive()
        time.sleep(wait)
        wheels.commands = commands
        at = time.monotonic()
        WAYS[way](terminal, wheels, clock)
        time.sleep(WATCHED)
        in_force = wheels.in_force(at)
        late = 0
        if way in SUSPENDS:
            wheels.commands = False
            time.sleep(0.6)
            before = len(wheels.heard)
            terminal.signal(signal.SIGCONT)
            time.sleep(WATCHED)
            late = sum(moves for _, moves in wheels.heard[before:])
        return {"way": way, "in_force_s": round(in_force, 3), "late_motions": late, "left": _left(terminal, way)}


def _left(terminal: Terminal, way: str, patience: float = 4.0) -> list[str]:
    """Return the nodes that have not ended, after an end that is that of all."""
    if way in SUSPENDS or way.startswith("clock"):
        return []
    until, left = time.monotonic() + patience, ["guard", "standby"]
    while left and time.monotonic() < until:
        time.sleep(0.1)
        left = [name for name in left if _runs(terminal.pid(name))]
    return left


def _runs(pid: int) -> bool:
    """Return whether a process runs; a zombie does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False
