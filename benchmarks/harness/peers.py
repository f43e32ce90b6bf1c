"""Peers: environments of other libraries, each in its own virtual environment and process."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import venv
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from harness import peer
from harness.environments import CARTPOLE, base_of, name_of
from harness.turns import Contender, Turn

PENDULUM = "Pendulum-v1"


class Entry(NamedTuple):
    """Environment of a peer's measurement."""

    env_id: str
    """Environment."""
    size: int
    """Number of environments stepped together."""
    form: str
    """Form of a call, see `harness.peer`."""


class Peer(NamedTuple):
    """A library measured for comparison."""

    title: str
    """Name of the library."""
    requirements: tuple[str, ...]
    """Requirements for pip, installed from wheels only."""
    pythons: str
    """Versions of Python that have wheels."""


PEERS = {
    # six: gymnax imports it without requiring it
    "gymnax": Peer("gymnax", ("gymnax==1.0.1", "jax==0.10.2", "six==1.17.0"), "3.11 to 3.14"),
    "envpool": Peer("EnvPool", ("envpool==1.2.5",), "3.11 to 3.14"),
}


def entries(name: str, sizes: Sequence[int]) -> list[Entry]:
    """Return the measurements of a peer: CartPole in its fastest form at each size, the rest at the first size.

    EnvPool is also measured at 1024, where it is faster.
    """
    if name == "envpool":
        return [Entry(CARTPOLE, size, "step") for size in dict.fromkeys((1024, sizes[0]))]
    rest = [Entry(CARTPOLE, sizes[0], "step"), Entry(PENDULUM, sizes[0], "scan"), Entry(PENDULUM, sizes[0], "step")]
    return [*(Entry(CARTPOLE, size, "scan") for size in sizes), *rest]


def install(name: str, folder: Path) -> Path:
    """Return the Python of a peer's virtual environment, which is created if it is missing or has other versions.

    Args:
        name: The peer.
        folder: The folder of all peers.

    Raises:
        ChildProcessError: If pip cannot install it.
    """
    title, requirements, pythons = PEERS[name]
    place = folder / f"{name}-{sys.version_info.major}.{sys.version_info.minor}"
    python, installed = place / "bin" / "python", place / "installed"
    if not python.exists() or not installed.exists() or installed.read_text(encoding="utf-8").split() != [*requirements]:
        print(f"Installing {' '.join(requirements)} into {place} ...", file=sys.stderr)
        shutil.rmtree(place, ignore_errors=True)
        venv.create(place, with_pip=True)
        pip = [str(python), "-I", "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--only-binary", ":all:"]
        done = subprocess.run([*pip, *requirements], capture_output=True, text=True, check=False)
        if done.returncode:
            here = f"{sys.version_info.major}.{sys.version_info.minor}"
            raise ChildProcessError(
                f"{title} cannot be installed for Python {here} (it has wheels for {pythons}): {_last_line(done.stderr)}"
            )
        installed.write_text("\n".join(requirements), encoding="utf-8")
    return python


class Process:
    """A peer's process, which waits for its turns.

    Args:
        command: Command that starts the process.
        log: File for its standard error.
        options: Passed on to `subprocess.Popen`.

    Raises:
        ChildProcessError: If the process ends before it is ready.
    """

    def __init__(self, command: Sequence[str], log: Path, **options: Any) -> None:
        self._log = log
        with log.open("w", encoding="utf-8") as errors:
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors, text=True, **options
            )  # fmt: skip
        try:
            self.versions: dict[str, str] = self._read("ready")
        except BaseException:
            self.stop()
            raise

    def turn(self, calls: int) -> Turn:
        """Make a number of calls."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(f"{calls}\n")
            self._process.stdin.flush()
        except BrokenPipeError:
            pass  # the process has ended, which reading detects
        return Turn(*self._read("turn"))

    def stop(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.communicate()

    def _read(self, word: str) -> Any:
        """Return the rest of the line that starts with a word; libraries may print other lines."""
        assert self._process.stdout is not None
        for line in self._process.stdout:
            if line.startswith(f"{word} "):
                return json.loads(line.removeprefix(word))
        last = _last_line(self._log.read_text(encoding="utf-8", errors="replace"))
        raise ChildProcessError(f"The peer has ended with status {self._process.wait()}: {last}")


class Present(NamedTuple):
    """Available peers."""

    contenders: dict[str, Contender]
    """Contenders by name."""
    versions: dict[str, dict[str, str]]
    """Versions of each peer, or under "missing" why it is not available."""


@contextmanager
def peers(folder: Path, sizes: Sequence[int]) -> Iterator[Present]:
    """Install and start all peers, and end them afterwards; one that cannot be installed or started is left out with the
    reason.

    Args:
        folder: Folder of their virtual environments.
        sizes: Numbers of environments stepped together.
    """
    contenders: dict[str, Contender] = {}
    versions: dict[str, dict[str, str]] = {}
    with ExitStack() as stack:
        for name, (title, *_) in PEERS.items():
            started = {}
            try:
                python = install(name, folder.absolute())
                for entry in entries(name, sizes):
                    command = [str(python), "-I", peer.__file__, name, *map(str, entry)]
                    process = Process(command, python.parents[1] / f"{'_'.join(map(str, entry))}.log")
                    stack.callback(process.stop)
                    versions[name] = process.versions
                    started[label(title, entry)] = contender(process, name, entry, sizes)
                contenders |= started
            except (OSError, subprocess.SubprocessError) as error:
                versions[name] = {"missing": " ".join(str(error).split())}
                print(f"Without {title}: {versions[name]['missing']}", file=sys.stderr)
        yield Present(contenders, versions)


def label(title: str, entry: Entry) -> str:
    """Return the name of a peer's contender."""
    words = ("lax.scan",) if entry.form == "scan" else ()
    return name_of(entry.size, f"{title}'s {entry.env_id}", *words)


def contender(process: Process, name: str, entry: Entry, sizes: Sequence[int]) -> Contender:
    """Return the contender of a process; its base has as many environments, or the first size if none has."""
    base = base_of(entry.size if entry.size in sizes else sizes[0])
    steps = peer.SCANNED if entry.form == "scan" else 1
    return Contender(run=process.turn, size=entry.size, base=base, by=name, steps=steps)


def _last_line(text: str) -> str:
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1] if lines else "there was no output."
