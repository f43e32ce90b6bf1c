"""Guard, standby and controller in a real terminal stop the robot however they end, and whatever the system clock says."""

import sys
from contextlib import closing
from pathlib import Path

import endings
import pytest
from bench import guarded

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
def test_the_child_of_a_standby_that_is_killed_ends_with_it(launch, wait_for, peer):
    standby = launch("-m", "turtlebot_gym_ros", "cmd_vel_standby")
    wait_for(lambda: peer.node.count_publishers("cmd_vel_standby/alive"))
    stayed = int(Path(f"/proc/{standby.pid}/task/{standby.pid}/children").read_text())
    standby.kill()
    wait_for(lambda: not endings._runs(stayed))
