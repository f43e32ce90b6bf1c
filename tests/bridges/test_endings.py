"""Guard, standby and controller in a real terminal stop the robot however they end, and whatever the system clock says."""

import os
import signal
import sys
import time
from contextlib import closing
from itertools import pairwise
from pathlib import Path

import pytest
from bench import node
from conftest import benchmark

endings = benchmark("endings")
DAILY = ("SIGTSTP", "SIGKILL", "closed", "clock -3600 s", "clock -3600 s, guard killed")
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="terminals and clocks are those of Linux")


@pytest.fixture
def wheels():
    with closing(endings.Wheels()) as wheels:
        yield wheels


@pytest.fixture
def clock(tmp_path):
    try:
        return endings.SystemClock(tmp_path)
    except FileNotFoundError as missing:
        pytest.skip(str(missing))


@pytest.mark.parametrize("way", [way if way in DAILY else pytest.param(way, marks=pytest.mark.nightly) for way in endings.WAYS])
def test_a_motion_is_in_force_for_half_a_second_at_most_after_every_end(way, wheels, clock, tmp_path):
    row = endings.end(way, wheels, tmp_path, clock=clock, wait=0.5, commands=True)
    assert row["in_force_s"] <= endings.LIMIT
    assert row["late_motions"] == 0
    assert row["left"] == []


def test_the_same_without_the_watch_on_waits_is_noticed(wheels, clock, tmp_path):
    """The emulated clock holds up a wait, as the kernel's does: else the test above would prove nothing."""
    program = f"{sys.executable} -c 'from turtlebot_gym_ros.base import swift; swift.OVERDUE = 60.0; {{main}}' --ros-args"
    main = "from turtlebot_gym_ros.robot.{0} import main; main()"
    guard, standby = (program.format(main=main.format(name)) for name in ("guard", "standby"))
    script = f"{guard} & echo $! > guard\n{standby} & echo $! > standby\nwait"
    row = endings.end("clock -3600 s", wheels, tmp_path, clock=clock, wait=0.5, commands=True, script=script)
    assert row["in_force_s"] > endings.LIMIT


ALONE = f"{sys.executable} {' '.join(node('simulated_teleop', 'start_enabled:=true'))} & echo $! > teleop\nwait"


def test_a_node_that_runs_by_a_timer_alone_goes_on_when_the_clock_is_set_back(wheels, clock, tmp_path):
    (tmp_path / "run").mkdir()
    wheels.commands = False
    with closing(endings.Terminal(tmp_path / "run", script=ALONE, **clock.variables)):
        wheels.drive(commands=False)
        clock.step(-3600.0)
        since = time.monotonic()
        time.sleep(1.0)
        times = [since, *(at for at, _ in wheels.heard if at > since), time.monotonic()]
    assert max(later - earlier for earlier, later in pairwise(times)) < endings.LIMIT


@pytest.mark.parametrize("leads", [True, False], ids=["a shell's job", "its child"])
def test_the_standby_is_in_a_session_of_its_own_and_ends_with_what_it_left(leads, launch, wait_for, peer, tmp_path):
    arguments = ["-m", "turtlebot_gym_ros", "cmd_vel_standby"]
    leader = "import os, sys; os.setpgid(0, 0); os.execv(sys.executable, [sys.executable, *sys.argv[1:]])"
    started = launch(*(["-c", leader] if leads else []), *arguments)
    wait_for(lambda: peer.node.count_publishers("cmd_vel_standby/alive"))
    family = [pid for pid in [*_children(started.pid), started.pid] if b"cmd_vel_standby" in _words(pid)]
    sessions = {pid: os.getsid(pid) for pid in family}
    (standby,) = (pid for pid, session in sessions.items() if pid == session)
    (stayed,) = (pid for pid, session in sessions.items() if session == os.getsid(0))
    assert (standby == started.pid) is not leads
    os.kill(stayed, signal.SIGHUP)
    assert started.wait(30) == 0
    wait_for(lambda: not endings._runs(standby))


def _children(pid):
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def _words(pid):
    return Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
