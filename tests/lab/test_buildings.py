"""The localizer on a stretch of a recorded building, if the recording is there, and what must change nothing."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")

from buildings import chart, load
from turtlebot_gym.drive import position_error
from turtlebot_gym.kernel import HAS_LLVM
from turtlebot_gym.localization.localizer import LOST
from turtlebot_gym.localization.tuning import ROBOT
from turtlebot_gym.values import Pose
from turtlebot_gym_lab.evaluation.localize import KNOWN, KnownPlace, localize

RECORDING = Path(__file__).parents[3] / "shared" / "data" / "carmen" / "aces.npz"
FRAMES, ROWS = 60, 300
pytestmark = [
    pytest.mark.slow,
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
    far = position_error(course.poses[drive.rows], drive.reference)
    assert np.median(far) < 0.045
    assert far.max() < 0.3
    assert not (course.states == LOST).any()
    wheels = follow(stretch, Pose(*drive.reference[0]), drive.recorded._replace(rows=np.zeros(0, np.int64)))
    assert np.median(position_error(wheels.poses[drive.rows], drive.reference)) > 0.2  # it is the scans that do it


def test_time_stamps_of_complete_scans_change_nothing(stretch):
    drive, _ = stretch
    start, recorded = Pose(*drive.reference[0]), drive.recorded
    course, shuffled = follow(stretch, start), np.random.default_rng(0).permutation(recorded.time)
    for stamps in (shuffled, -recorded.time):
        stamped = follow(stretch, start, recorded._replace(time=stamps, last=stamps))
        np.testing.assert_array_equal(stamped.poses, course.poses)
        np.testing.assert_array_equal(stamped.covariances, course.covariances)
