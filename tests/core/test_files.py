"""Files are written as a whole or not at all, and only what is a file is read; the whole product does so by one module."""

import os
import resource
import signal
import socket
import stat
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

from turtlebot_gym import Robot, files
from turtlebot_gym.bounded import bounded
from turtlebot_gym.presets import make_noise, make_robot
from turtlebot_gym.rooms.worlds import find_world

OLD = "what was there before"


@contextmanager
def full_disk(left=64):
    """Let no file grow beyond some bytes within this block, as on a disk that is full."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (left, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.fixture
def old(tmp_path):
    path = tmp_path / "result.yaml"
    path.write_text(OLD)
    return path


def alone(path):
    """Return whether a file is the only one in its folder."""
    return list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize(
    "write", [lambda path: files.write_text(path, "x" * 100), lambda path: files.write_parameters(make_noise("rough"), path)]
)
def test_a_full_disk_leaves_the_old_file_and_nothing_else(old, write):
    with full_disk(), pytest.raises(OSError, match="File too large"):
        write(old)
    assert old.read_text() == OLD
    assert alone(old)
    write(old)
    assert old.read_text() != OLD
    assert alone(old)


def test_an_error_or_an_interrupt_in_the_middle_leaves_the_old_file(old):
    def half(error):
        with files.replacing(old) as beside:
            beside.write_text("half")
            raise error

    for error in (RuntimeError, KeyboardInterrupt):
        with pytest.raises(error):
            half(error)
        assert old.read_text() == OLD
        assert alone(old)


def test_a_link_stays_a_link_and_permissions_stay(old, tmp_path):
    link = tmp_path / "link.yaml"
    link.symlink_to(old.name)
    old.chmod(0o640)
    files.write_text(link, "new")
    assert link.is_symlink()
    assert old.read_text() == "new"
    assert stat.S_IMODE(old.stat().st_mode) == 0o640
    files.write_text(tmp_path / "here" / "new.txt", "in a folder that was missing")
    assert (tmp_path / "here" / "new.txt").read_text() == "in a folder that was missing"


def test_a_pipe_and_a_device_are_written_to(tmp_path):
    pipe, heard = tmp_path / "pipe", []
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: heard.append(pipe.read_text()))
    reader.start()
    files.write_text(pipe, "through it")
    reader.join(10.0)
    assert heard == ["through it"]
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    files.write_text("/dev/null", "away")
    assert stat.S_ISCHR(Path("/dev/null").stat().st_mode)


def test_a_file_that_grows_while_it_is_written_is_never_seen_in_parts(tmp_path):
    path, seen = tmp_path / "a.txt", set()
    files.write_text(path, "0" * 10_000)
    stop = threading.Event()

    def watch():
        while not stop.is_set():
            seen.add(path.read_text())

    watcher = threading.Thread(target=watch)
    watcher.start()
    for number in range(200):
        files.write_text(path, str(number % 10) * 10_000)
    stop.set()
    watcher.join()
    assert seen <= {str(number) * 10_000 for number in range(10)}


@pytest.fixture
def odd(tmp_path):
    """Paths by what they are, and what a message must say of each: none of them is a file."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to("pipe")
    (tmp_path / "folder").mkdir()
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(tmp_path / "socket"))
    places = {"pipe": "a pipe", "link": "a pipe", "folder": "a folder", "socket": "a socket"}
    return {tmp_path / name: text for name, text in places.items()} | {Path("/dev/zero"): "a device"}


def test_what_is_no_file_is_refused_before_it_is_opened(odd):
    for path, text in odd.items():
        with pytest.raises(ValueError, match=f": it is {text}; save"):
            files.read_text(path)
    with pytest.raises(FileNotFoundError):
        files.read_text("nowhere.txt")


def test_the_readers_of_the_core_refuse_a_pipe(tmp_path, write_map):
    for suffix in (".yaml", ".yml", ".json", ".world", ".sdf"):
        os.mkfifo(tmp_path / f"pipe{suffix}")
    since = time.monotonic()
    for read in (make_robot, make_noise):
        with pytest.raises(ValueError, match="it is a pipe; save what it holds as a file, and give that"):
            read(str(tmp_path / "pipe.yaml"))
    for suffix in (".yaml", ".world", ".sdf"):
        with pytest.raises(ValueError, match="it is a pipe"):
            find_world(str(tmp_path / f"pipe{suffix}"))
    with pytest.raises(ValueError, match="it is a pipe"):
        files.load(tmp_path / "pipe.json")
    path = write_map(tmp_path)
    (tmp_path / "map.pgm").unlink()
    os.mkfifo(tmp_path / "map.pgm")
    with pytest.raises(ValueError, match=r"map.pgm: it is a pipe"):
        find_world(path)
    assert time.monotonic() - since < 5.0


def test_files_that_are_too_large_are_refused_with_their_size(tmp_path):
    with (tmp_path / "large.json").open("wb") as file:
        file.truncate(10**9)
    with pytest.raises(ValueError, match=r"large.json: it has 1,000 MB; at most 67 MB are read"):
        files.load(tmp_path / "large.json")


def test_a_call_in_a_copy_of_the_process_returns_and_raises_as_in_this_one():
    noted = []
    assert bounded(lambda: noted.append(1) or {"a": Robot(max_linear=1.0, max_angular=1.0)}, "a")["a"].max_linear == 1.0
    assert not noted

    def fail():
        raise FileNotFoundError(2, "No such file", "b.txt")

    with pytest.raises(FileNotFoundError, match="No such file"):
        bounded(fail, "b.txt")


def endless():
    while True:
        pass


def greedy():
    return sum(len(bytes(10**7)) for _ in [bytearray(b"x" * 10**8) for _ in range(100)])


def aborting():
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.parametrize("call", [endless, greedy, aborting, lambda: bytearray(10**12)])
def test_a_call_without_bounds_is_ended_with_one_line(call, monkeypatch, capfd):
    monkeypatch.setattr("turtlebot_gym.bounded.SECONDS", 1)
    since = time.monotonic()
    with pytest.raises(ValueError, match=r"^c.txt: reading it takes more than 1 s of computing or 400 MB of memory: .*\.$"):
        bounded(call, "c.txt")
    assert time.monotonic() - since < 30.0
    assert capfd.readouterr() == ("", "")
    own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss  # which the copy of this process begins with
    assert resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss < 6 * 10**5 + own  # kB
