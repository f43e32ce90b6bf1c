"""The localizer on a stretch of a recorded building, if the recording is there, and what must change nothing."""

import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")

from building import chart, load
from turtlebot_gym.drive import heading_error, position_error
from turtlebot_gym.kernel import HAS_LLVM
from turtlebot_gym.localization.localizer import LOST, TRACKING
from turtlebot_gym.localization.tuning import ROBOT
from turtlebot_gym.values import Pose
from turtlebot_gym_agents.commands.cli import main
from turtlebot_gym_lab.evaluation.localize import KNOWN, KnownPlace, errors_of, localize

RECORDING = Path(__file__).parents[3] / "shared" / "data" / "carmen" / "aces.npz"
FRAMES, ROWS = 60, 300
pytestmark = [
    pytest.mark.touched("lab", "tests/lab"),
    pytest.mark.skipif(not RECORDING.exists(), reason="needs the recordings"),
    pytest.mark.skipif(not HAS_LLVM, reason="takes minutes in plain Python"),
]


@pytest.fixture(scope="module")
def stretch():
    """The first key frames of a building, the drive over them, and their map."""
    whole = load(RECORDING)
    drive = whole._replace(rows=whole.rows[:FRAMES], reference=whole.reference[:FRAMES])
    end = int(drive.rows[-1]) + 1
    recorded = drive.recorded
    cut = recorded._replace(**{name: getattr(recorded, name)[:end] for name in ("time", "odometry", "rows", "last", "ranges")})
    return drive._replace(recorded=cut), chart(drive, 0.05)


def follow(stretch, start, recorded=None):
    drive, chart = stretch
    return localize(recorded or drive.recorded, KnownPlace(*chart, ROBOT, start, KNOWN))


def test_the_belief_stays_with_the_reference(stretch):
    drive, _ = stretch
    course = follow(stretch, Pose(*drive.reference[0]))
    errors = errors_of(course, drive.rows, drive.reference)
    assert errors["median"] < 0.045
    assert errors["worst"] < 0.3
    assert not (course.states == LOST).any()
    wheels = follow(stretch, Pose(*drive.reference[0]), drive.recorded._replace(rows=np.zeros(0, np.int64)))
    assert errors_of(wheels, drive.rows, drive.reference)["median"] > 0.2  # it is the scans that do it


def test_time_stamps_of_complete_scans_change_nothing(stretch):
    drive, _ = stretch
    start, recorded = Pose(*drive.reference[0]), drive.recorded
    course, shuffled = follow(stretch, start), np.random.default_rng(0).permutation(recorded.time)
    for stamps in (shuffled, -recorded.time):
        stamped = follow(stretch, start, recorded._replace(time=stamps, last=stamps))
        np.testing.assert_array_equal(stamped.poses, course.poses)
        np.testing.assert_array_equal(stamped.covariances, course.covariances)


def after_one_scan(stretch, off):
    """Return the errors of position and heading of starts at places all along the way, each off by the same."""
    drive, chart = stretch
    errors = []
    for row, true in zip(drive.rows[::6].tolist(), drive.reference[::6], strict=True):
        pose = localize(drive.recorded, KnownPlace(*chart, ROBOT, Pose(*(true + off)), KNOWN, row)).poses[row]
        errors.append((position_error(pose, true), heading_error(pose, true)))
    return np.array(errors).T


@pytest.mark.parametrize("turn", [0.3, -0.3])
def test_one_scan_corrects_a_start_that_is_turned(stretch, turn):
    position, heading = after_one_scan(stretch, (0.0, 0.0, turn))
    assert position.max() < 0.1
    assert heading.max() < 0.03


@pytest.mark.parametrize("shift", [(0.3, 0.0), (0.0, -0.3)])
def test_one_scan_corrects_a_start_that_is_shifted_unless_along_a_corridor(stretch, shift):
    position, heading = after_one_scan(stretch, (*shift, 0.0))
    assert np.median(position) < 0.1
    assert position.max() < 0.3  # along a corridor a scan says little
    assert heading.max() < 0.03


@pytest.fixture
def files(stretch, tmp_path, write_map):
    """The columns of the stretch's log, and its map as a file."""
    drive, chart = stretch
    recorded, side = drive.recorded, float(chart.frame[4])
    centimetres = np.rint(recorded.ranges * 100.0).astype(np.uint16)
    columns = {"time": recorded.time, "odometry": recorded.odometry, "ranges_cm": centimetres}
    shades = np.where(chart.field == 0.0, 0, np.where(np.isnan(chart.field), 205, 254)).astype(np.uint8)
    corner = [*chart.frame[:2].tolist(), 0.0]
    return columns, write_map(tmp_path, shades[::-1], resolution=side, origin=corner, free_thresh=0.196)


@pytest.mark.nightly
@pytest.mark.parametrize("start", [("500", "500", "0"), ("unknown",)])
def test_without_truth_the_command_says_how_sure_it_is_and_a_lost_robot_is_found(stretch, files, tmp_path, capsys, start):
    """Within 5 s, and it is lost after 2 s at most; no row is tracking while it is wrong."""
    (columns, map_file), (drive, _) = files, stretch
    log, result = tmp_path / "log.npz", tmp_path / "result.json"
    np.savez(log, **columns)
    assert main(["localize", str(log), "--map", str(map_file), "--start", *start, "--json", str(result)]) == 0
    printed, content = capsys.readouterr().out, json.loads(result.read_text())
    for words in ("beams that fit the map, mean, %", "leaps of more than 0.3 m or 0.3 rad", "lost, % of the rows"):
        assert words in printed
    states, time = np.array(content["states"]), np.array(content["time"]) - content["time"][0]
    found = int(np.flatnonzero(states == TRACKING)[0])
    assert LOST in states[time < 2.0]
    assert time[found] < 5.0
    judged = (drive.rows >= found) & (drive.rows < len(states))  # no row follows the last scan
    assert position_error(np.array(content["poses"])[drive.rows[judged]], drive.reference[judged]).max() < 0.5
    assert content["evidence"]["leaps"] <= 1


@pytest.mark.nightly
def test_the_command_localizes_a_log_in_a_map_file(stretch, files, tmp_path, capsys):
    (columns, map_file), (drive, _) = files, stretch
    log, result = tmp_path / "log.npz", tmp_path / "result.json"
    np.savez(log, **columns, reference_row=drive.rows, reference=drive.reference)
    written = ["--json", str(result), "--plot", str(tmp_path / "path.png")]
    assert main(["localize", str(log), "--map", str(map_file), *written]) == 0
    content = json.loads(result.read_text())
    assert content["errors"]["median"] < 0.045
    assert content["errors"]["lost"] == 0.0
    assert content["shares"]["lost"] == 0.0
    assert len(content["poses"]) == len(content["time"])
    assert (tmp_path / "path.png").stat().st_size > 0
    np.savez(log, **columns)
    capsys.readouterr()
    assert main(["localize", str(log), "--map", str(map_file)]) == 2
    assert "--start must say" in capsys.readouterr().err
    wheels = tmp_path / "drive.csv"
    wheels.write_text("t,vx,gyro,px,py,theta\n0,0,0,0,0,0\n1,0,0,0,0,0\n2,0,0,0,0,0\n")
    assert main(["localize", str(wheels), "--map", str(map_file)]) == 2
    assert "needs odometry and scans" in capsys.readouterr().err
