"""A truth in transforms is the chain of frames that is asked for, and never odometry itself."""

import math
from dataclasses import replace

import numpy as np
import pytest
from drawing import draw
from rosbag_messages import ODOMETRY, TF, make, odometry, transform, write_bag

from turtlebot_gym_lab.calibration import calibrate
from turtlebot_gym_lab.drives import read

START = 100.0
DRAWN = draw(200, dt=0.05, deviations=(0.0, 0.0, 0.0))
SAID = np.column_stack([0.9 * DRAWN.truth[:, :2], 0.8 * DRAWN.truth[:, 2]])  # wheels that are off


def composed(first, second):
    x, y, theta = first
    c, s = math.cos(theta), math.sin(theta)
    return x + c * second[0] - s * second[1], y + s * second[0] + c * second[1], theta + second[2]


def inverse(pose):
    x, y, theta = pose
    c, s = math.cos(theta), math.sin(theta)
    return -c * x - s * y, s * x - c * y, -theta


def bag(folder, *edges, every=2, ahead=0.0):
    """Write a bag of wheels that are off, with their transform; ``edges``: topic, parent, child, and the poses or one pose."""
    messages = []
    for k, time in enumerate(START + DRAWN.time):
        said = odometry(time, SAID[k], DRAWN.twist[k])
        said.child_frame_id = "base_footprint"
        messages += [("/odom", ODOMETRY, time, said)]
        parts = [("/tf", "odom", "base_footprint", SAID[k], time)]
        for topic, parent, child, poses in edges:
            one = np.ndim(poses) == 1
            if k == 0 or not ((one and topic == "/tf_static") or k % every):
                parts.append((topic, parent, child, poses if one else poses[k], time + (0.0 if one else ahead)))
        messages += [
            (topic, TF, time, make(TF, [transform(at, place, child, parent)])) for topic, parent, child, place, at in parts
        ]
    return write_bag(folder, messages)


CORRECTION = np.array([composed(truth, inverse(said)) for truth, said in zip(DRAWN.truth, SAID, strict=True)])
MAP = "/tf", "map", "odom", CORRECTION
BODY = "/tf_static", "base_footprint", "base_link", (0.03, 0.0, 0.0)


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    ("edges", "truth", "offset"),
    [
        ((MAP,), "/tf:map.base_footprint", (0.0, 0.0, 0.0)),
        ((MAP,), "/tf:base_footprint", (0.0, 0.0, 0.0)),
        ((MAP,), "/tf:map.base_footprint:/tf_static", (0.0, 0.0, 0.0)),
        ((MAP, BODY), "/tf:map.base_link", (0.03, 0.0, 0.0)),
        ((("/tf", "odom", "map", np.array([inverse(pose) for pose in CORRECTION])),), "/tf:map.base_footprint", (0, 0, 0)),
        ((("/tf", "world", "marker.1", DRAWN.truth),), "/tf:world.marker.1", (0.0, 0.0, 0.0)),
        ((("/tf", "world", "marker.1", DRAWN.truth),), "/tf:marker.1", (0.0, 0.0, 0.0)),
    ],
)
def test_the_truth_is_the_chain_from_the_frame_that_is_asked_for(tmp_path, edges, truth, offset):
    drive = read(bag(tmp_path / "bag", *edges), truth=truth)
    expected = np.array([composed(pose, offset) for pose in DRAWN.truth])
    np.testing.assert_allclose(drive.truth[:199, :2], expected[:199, :2], atol=0.01)
    np.testing.assert_allclose(np.sin(drive.truth[:199, 2] - expected[:199, 2]), 0.0, atol=0.06)
    assert not any("clock" in remark for remark in drive.remarks)


def test_a_correction_that_is_stamped_ahead_is_no_other_clock(tmp_path):
    drive = read(bag(tmp_path / "bag", MAP, ahead=1.0), truth="/tf:map.base_footprint")
    assert not any("clock" in remark for remark in drive.remarks)
    there = np.isfinite(drive.truth[:, 0])
    assert np.hypot(*(drive.truth - DRAWN.truth)[there, :2].T).max() < 0.1  # it is a second old


FIXED = "/tf_static", "map", "odom", (1.0, 0.0, 0.0)


@pytest.mark.sample(4)
@pytest.mark.parametrize(
    ("edges", "truth", "message"),
    [
        ((MAP,), "/tf:odom.base_footprint", "/tf:odom.base_footprint is the odometry itself: say /tf:map.base_footprint"),
        ((MAP,), "/tf:/odom./base_footprint", "is the odometry itself: say /tf:map.base_footprint"),
        ((), "/tf:base_footprint", "is the odometry itself: the bag has odom.base_footprint, and no frame that says"),
        ((FIXED,), "/tf:map.base_footprint", "is the odometry itself, since 'map' is fixed to odometry's frame 'odom'"),
        ((MAP, BODY), "/tf:odom.base_link", "is the odometry itself: say /tf:map.base_footprint"),
        ((MAP,), "/tf", "holds transforms: name the robot's frame .*: say /tf:map.base_footprint"),
        ((MAP,), "/tf:map.odom", "is not the robot: 'odom' moves against 'base_footprint': say /tf:map.base_footprint"),
        ((MAP,), "/tf:map.wheel", "has no messages about 'wheel': say /tf:map.base_footprint"),
        ((MAP,), "/tf:base_footprint.base_footprint", "names the same frame twice"),
        ((MAP, ("/tf", "hall", "hand", DRAWN.truth)), "/tf:hall.base_footprint", "no transforms lead from 'hall'"),
        ((MAP, ("/tf", "hall", "base_footprint", DRAWN.truth)), "/tf:base_footprint", "above it is 'hall', 'map': say /tf:"),
        ((FIXED, BODY), "/tf:base_footprint.base_link", "does not move: 'base_link' is fixed in 'base_footprint'"),
    ],
)
def test_odometry_and_wrong_frames_are_refused_with_the_right_words(tmp_path, edges, truth, message):
    with pytest.raises(ValueError, match=message) as refusal:
        read(bag(tmp_path / "bag", *edges), truth=truth)
    assert "\n" not in str(refusal.value)


def test_a_truth_that_moves_as_odometry_does_calibrates_nothing():
    with pytest.raises(ValueError, match="it is the odometry itself, or a simulation without noise"):
        calibrate(replace(DRAWN, odometry=np.array([composed((1.0, 2.0, 0.5), pose) for pose in DRAWN.truth])))
