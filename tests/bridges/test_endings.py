"""Guard, standby and controller in a real terminal stop the robot however they end, and whatever the system clock says."""

import os
import signal
import sys
import time
from contextlib import closing
from itertools import pairwise
from pathlib import Path

import endings
import pytest
from bench import guarded, node
from burger import WORDS

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


@pytest.mark.sample(1)
@pytest.mark.parametrize("way", [way if way in DAILY else pytest.param(way, marks=pytest.mark.nightly) for way in endings.WAYS])
def test_a_motion_is_in_force_for_half_a_second_at_most_after_every_end(way, wheels, clock, tmp_path):
    row = endings.end(way, wheels, tmp_path, clock=clock, wait=0.5, commands=True)
    assert row["in_force_s"] <= endings.LIMIT
    assert row["late_motions"] == 0
    assert row["left"] == []


@guarded
def test_the_same_without_the_watch_on_waits_is_noticed(wheels, clock, tmp_path):
    """The emulated clock holds up a wait, as the kernel's does: else the test above would prove nothing."""
    program = f"{sys.executable} -c 'from cmd_vel_guard import executor; executor.OVERDUE = 60.0; {{main}}' --ros-args"
    main = 'from turtlebot_gym_ros.nodes import load; import sys; load("cmd_vel_{0}")(sys.argv[1:])'
    guard, standby = (program.format(main=main.format(name)) for name in ("guard", "standby"))
    script = f"{guard} {' '.join(WORDS)} & echo $! > guard\n{standby} & echo $! > standby\nwait"
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


@pytest.mark.usefixtures("hangs_up")
@guarded
def test_the_standby_is_in_a_session_of_its_own_and_ends_with_the_child_that_it_left_in_the_old_one(launch, wait_for, peer):
    standby = launch("-m", "turtlebot_gym_ros", "cmd_vel_standby")
    wait_for(lambda: peer.node.count_publishers("cmd_vel_standby/alive"))
    assert os.getsid(standby.pid) == standby.pid
    (stayed,) = (int(pid) for pid in Path(f"/proc/{standby.pid}/task/{standby.pid}/children").read_text().split())
    assert os.getsid(stayed) == os.getsid(0)
    os.kill(stayed, signal.SIGHUP)
    assert standby.wait(30) == 0


@guarded
def test_the_child_of_a_standby_that_is_killed_ends_with_it(launch, wait_for, peer):
    standby = launch("-m", "turtlebot_gym_ros", "cmd_vel_standby")
    wait_for(lambda: peer.node.count_publishers("cmd_vel_standby/alive"))
    stayed = int(Path(f"/proc/{standby.pid}/task/{standby.pid}/children").read_text())
    standby.kill()
    wait_for(lambda: not endings._runs(stayed))
