"""Where the sensors of a recording are: any chain of transforms, on either topic, of ROS 1 or 2; an assumed mount is said."""

import math

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from rosbag_messages import ODOMETRY, TF, TRANSFORM, header, make, odometry, vector, write_bag, write_ros_1
from scipy.spatial.transform import Rotation

from turtlebot_gym.rooms.lidar import LIDARS
from turtlebot_gym_lab.drives import read
from turtlebot_gym_lab.drives.messages import DriveListener

pytestmark = pytest.mark.touched("lab", "tests/lab")

START, ROWS = 1e9, 12
SCAN, IMU = "sensor_msgs/msg/LaserScan", "sensor_msgs/msg/Imu"
RANGES = np.array([1.0, 2.0, 1.5, 0.5], np.float32)
FIRST, INCREMENT = -0.7, 0.4
TURNED_BY_PI = ((-0.1, 0.0, 0.2), (0.0, 0.0, math.pi))

TILTED = ((0.0, 0.0, 0.0), (0.0, 0.5, 0.0))


def edge(seconds, parent, child, place):
    (x, y, z), angles = place
    q = Rotation.from_euler("xyz", angles).as_quat().tolist()
    rotation = make("geometry_msgs/msg/Quaternion", *q)
    return make(TRANSFORM, header(seconds, parent), child, make("geometry_msgs/msg/Transform", vector(x, y, z), rotation))


def messages(edges, *, topic="/tf_static", every=1, frame="laser", body="base_link", rates=None, at=(0.0, 0.0, 0.3)):
    """Return the messages of a robot that drives, with scans; ``edges``: parent, child, and place or a function of the row."""
    said = []
    for k in range(ROWS):
        time, place = START + 0.1 * k, (at[0] + 0.02 * k, at[1], at[2])
        moved = odometry(time, place, (0.2, 0.1))
        moved.child_frame_id = body
        said.append(("/odom", ODOMETRY, time, moved))
        moving = [edge(time, "odom", body or "base_link", ((*place[:2], 0.0), (0.0, 0.0, place[2])))]
        said.append(("/tf", TF, time + 0.001, make(TF, moving)))
        if k % every == 0 and (topic == "/tf" or k == 0):
            for parent, child, where in edges:
                stated = edge(time, parent, child, where(k) if callable(where) else where)
                said.append((topic, TF, time + 0.002, make(TF, [stated])))
        limits = (FIRST, FIRST + 3 * INCREMENT, INCREMENT, 0.0, 0.1, 0.1, 10.0)
        said.append(("/scan", SCAN, time + 0.003, make(SCAN, header(time, frame), *limits, RANGES, np.zeros(0, np.float32))))
        if rates is not None:
            still = np.zeros(9)
            q = make("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0)
            turning = make(IMU, header(time, "imu"), q, still, vector(*rates), still, vector(), still)
            said.append(("/imu", IMU, time + 0.004, turning))
    return said


def ends_of(drive):
    """Return where the beams of each scan end on the robot, shape (S, B, 2), m."""
    ends = []
    for seen in drive.scans:
        around = seen.mount.theta + seen.scan.first + seen.scan.increment * np.arange(len(seen.scan.ranges))
        x, y = (of(around) * seen.scan.ranges for of in (np.cos, np.sin))
        ends.append(np.stack([seen.mount.x + x, seen.mount.y + y], axis=1))
    return np.array(ends)


def expected(places):
    """Return where the beams end by the textbook: rotations and translations, one after the other."""
    around = FIRST + INCREMENT * np.arange(len(RANGES))
    points = np.stack([np.cos(around) * RANGES, np.sin(around) * RANGES, 0.0 * around], axis=1)
    for at, angles in reversed(places):
        points = Rotation.from_euler("xyz", angles).apply(points) + at
    return points[:, :2]


COORDINATE, ANGLE = st.floats(-0.5, 0.5), st.floats(-math.pi, math.pi)
INVERTED = st.sampled_from([0.0, math.pi])
LEVEL = st.tuples(st.tuples(COORDINATE, COORDINATE, COORDINATE), st.tuples(INVERTED, st.just(0.0), ANGLE))


@pytest.mark.nightly
@settings(max_examples=12, phases=(Phase.generate,))
@given(
    places=st.lists(LEVEL, min_size=1, max_size=3),
    form=st.sampled_from([("/tf_static", 2), ("/tf", 2), ("/tf", 1)]),
    slashes=st.sampled_from(["", "/"]),
    is_stated_down=st.booleans(),
    body=st.sampled_from(["base_link", "/base_link", ""]),
)
def test_beams_end_where_the_chain_of_transforms_says(tmp_path_factory, places, form, slashes, is_stated_down, body):
    topic, version = form
    names = ["base_link", *(f"plate{k}" for k in range(len(places) - 1)), "laser"]
    edges = [(slashes + parent, child, place) for parent, child, place in zip(names, names[1:], places, strict=False)]
    said = messages(edges if is_stated_down else edges[::-1], topic=topic, frame=f"{slashes}laser", body=body)
    folder = tmp_path_factory.mktemp("mount")
    drive = read(write_ros_1(folder / "a.bag", said) if version == 1 else write_bag(folder / "bag", said))
    assert len(drive.scans) >= ROWS - 1
    np.testing.assert_allclose(ends_of(drive), np.broadcast_to(expected(places), (len(drive.scans), 4, 2)), atol=2e-6)
    assert not any("assumed" in remark for remark in drive.remarks)


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    ("edges", "said"),
    [
        ([], "no transform says where 'laser' is on 'base_link'"),
        ([("plate", "laser", TURNED_BY_PI)], "no transform says where 'laser' is on 'base_link'"),
        ([("base_link", "laser", lambda k: ((0.0, 0.0, 0.0), (0.0, 0.0, 0.1 * k)))], "'laser' moves against 'base_link'"),
        (
            [("base_link", "laser", ((0.0, 0.0, 0.0), (0.0, 0.5, 0.0)))],
            "'laser' is tilted by 29 degrees, and a scan must be level",
        ),
        ([("base_link", "laser", TURNED_BY_PI), ("odom", "laser", TURNED_BY_PI)], ""),
    ],
)
def test_where_no_transform_states_a_mount_it_is_assumed_and_that_is_said(tmp_path, edges, said):
    drive = read(write_bag(tmp_path / "bag", messages(edges, topic="/tf")), lidar="lds01")
    preset = LIDARS["lds01"]
    if said:
        (remark,) = drive.remarks
        assert f"bag: {said}: the LiDAR is assumed at x -0.032 m, y 0.000 m, turned by 0.000 rad" in remark
        assert remark.endswith("as its preset has it; --mount X Y YAW states its pose")
        assert drive.scans[0].mount == (preset.x, preset.y, preset.yaw)
    given = read(tmp_path / "bag", mount=(-0.1, 0.0, math.pi))
    np.testing.assert_allclose(ends_of(given)[0], expected([TURNED_BY_PI]), atol=2e-6)
    assert given.remarks == ()


def test_a_frame_that_tf_static_states_twice_is_not_believed(tmp_path):
    rivals = [("base_link", "laser", TURNED_BY_PI), ("base_link", "laser", ((0.1, 0.0, 0.0), (0.0, 0.0, 0.0)))]
    (remark,) = read(write_bag(tmp_path / "bag", messages(rivals))).remarks
    assert "/tf_static states two different poses of 'laser': the LiDAR is assumed" in remark


def test_a_mount_that_is_given_counts_and_contradicts_aloud(tmp_path):
    folder = write_bag(tmp_path / "bag", messages([("base_link", "laser", TURNED_BY_PI)]))
    drive = read(folder, mount=(0.2, 0.0, 0.0))
    assert drive.scans[0].mount == (0.2, 0.0, 0.0)
    assert "as given, and not as /tf_static states" in drive.remarks[0]
    assert "by /tf_static and not by its preset" in read(folder).remarks[0]


def test_a_mount_without_scans_is_refused(tmp_path):
    folder = write_bag(tmp_path / "bag", [message for message in messages([]) if message[0] != "/scan"])
    with pytest.raises(ValueError, match="mount says where a LiDAR is, and the bag holds no scans"):
        read(folder, mount=(0.0, 0.0, 0.0))
    (tmp_path / "table.csv").write_text("t,vx,gyro,px,py\n" + "".join(f"{k},0.1,0,{0.1 * k},0\n" for k in range(9)))
    with pytest.raises(ValueError, match="a table holds no scans"):
        read(tmp_path / "table.csv", mount=(0.0, 0.0, 0.0))


@pytest.mark.sample(2)
@pytest.mark.parametrize("topic", ["/tf_static", "/tf"])
@pytest.mark.parametrize("angles", [(math.pi, 0.0, 0.4), (0.5 * math.pi, 0.0, 0.0), (0.3, -1.0, 2.0), (0.0, 0.0, 1.0)])
def test_the_rate_of_an_imu_is_turned_into_the_robots_frame(tmp_path, topic, angles):
    rates = Rotation.from_euler("xyz", angles).inv().apply([0.0, 0.0, 0.35])
    stated = [("base_link", "laser", TURNED_BY_PI), ("laser", "imu", ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))]
    turned = Rotation.from_euler("xyz", TURNED_BY_PI[1]).inv() * Rotation.from_euler("xyz", angles)
    stated[1] = ("laser", "imu", ((0.0, 0.1, 0.0), tuple(turned.as_euler("xyz"))))
    drive = read(write_bag(tmp_path / "bag", messages(stated, topic=topic, rates=rates)))
    np.testing.assert_allclose(drive.gyro[:-1], 0.35, atol=1e-9)
    assert any("the IMU is tilted" in remark for remark in drive.remarks) == (angles[:2] != (0.0, 0.0))


def test_an_imu_that_nothing_states_is_assumed_level(tmp_path):
    drive = read(write_bag(tmp_path / "bag", messages([("base_link", "laser", TURNED_BY_PI)], rates=(0.1, 0.2, 0.35))))
    np.testing.assert_allclose(drive.gyro[:-1], 0.35)
    assert any("where 'imu' is on 'base_link': the IMU is assumed level" in remark for remark in drive.remarks)


def test_the_law_of_beams_can_fail(tmp_path, monkeypatch):
    """Without the transforms of /tf, as of ROS 1, the beams end on the other side of the robot."""
    folder = write_bag(tmp_path / "bag", messages([("base_link", "laser", TURNED_BY_PI)], topic="/tf"))
    hear = DriveListener.hear

    def deaf(listener, topic, message, received):
        return topic == "mounts" or hear(listener, topic, message, received)

    monkeypatch.setattr(DriveListener, "hear", deaf)
    assert np.abs(ends_of(read(folder))[0] - expected([TURNED_BY_PI])).max() > 1.0
