"""Values and messages: what goes over a topic comes back, and what is no pose is refused."""

import math

import numpy as np
import pytest
from bench import over_the_wire
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, Quaternion
from std_msgs.msg import Header

from turtlebot_gym import values
from turtlebot_gym.estimation.ekf import Estimate
from turtlebot_gym.estimation.filters import covariance_of
from turtlebot_gym.rooms.grid import GridMap
from turtlebot_gym.rooms.scan import Clearance, Obstacles, Scan
from turtlebot_gym.values import Belief, Command, Covariance, Fix, Pose, State
from turtlebot_gym_ros.node.block import InitialPose, Nis
from turtlebot_gym_ros.node.convert import conversion, register
from turtlebot_gym_ros.node.geometry import _yaw_of, half_turn

HEADER = Header(frame_id="odom")
P = Covariance(xx=0.11, xy=0.12, xt=0.13, yy=0.22, yt=0.23, tt=0.33, vv=0.44, ww=0.55)
BELIEF = Belief(State(1.0, 2.0, math.pi / 3.0, 0.4, -0.5), P)


def write(value, **options):
    return conversion(type(value), **options).write(value, HEADER)


def travel(value):
    way = conversion(type(value))
    return way.read(way.write(value, HEADER))


def a_covariance(rng):
    root = rng.normal(size=(5, 5))
    return covariance_of(root @ root.T)


@pytest.mark.parametrize(
    "theta", [0.0, 1e-9, -1e-9, 1e-300, 0.12487552222276889, 1.0, -2.0, math.pi / 2, -math.pi, math.nextafter(math.pi, 0.0)]
)
def test_headings_survive_the_quaternion(theta):
    for _ in range(50):  # and their neighbours
        z, w = half_turn(theta)
        assert _yaw_of(Quaternion(z=z, w=w)) == theta
        theta = math.nextafter(theta, 0.0)


@pytest.mark.parametrize("measured", [True, False])
def test_odometry_says_whether_it_was_measured_and_with_which_twist(measured):
    odometry = values.Odometry(Pose(1.0, -2.0, 0.5), Command(0.1, -0.3), measured)
    message = conversion(values.Odometry).write(odometry, HEADER)
    assert message.pose.covariance[0] == (0.0 if measured else -1.0)
    assert (message.twist.twist.linear.x, message.twist.twist.angular.z) == (0.1, -0.3)
    assert travel(odometry) == odometry


@pytest.mark.parametrize("heading", [0.04, math.inf])
def test_a_fix_states_its_covariance_and_minus_one_for_a_heading_that_was_not_measured(heading):
    cross = (-0.01, 0.004, 0.005) if heading < math.inf else (-0.01, 0.0, 0.0)
    fix = Fix(Pose(1.0, -2.0, 0.5 if heading < math.inf else 0.0), (0.01, 0.02, heading), 0.0, True, cross)
    message = conversion(Fix).write(fix, HEADER)
    assert [message.pose.covariance[at] for at in (0, 7, 35)] == [0.01, 0.02, 0.04 if heading < math.inf else -1.0]
    assert [message.pose.covariance[at] for at in (1, 5, 11)] == [message.pose.covariance[at] for at in (6, 30, 31)] == [*cross]
    assert travel(fix) == fix
    if heading == math.inf:
        message.pose.pose.orientation.w = 0.0  # as who measures a position leaves it
        assert conversion(Fix).read(message) == fix


def test_an_initial_pose_may_state_no_covariance_and_then_has_that_of_rviz():
    """As Nav2's clients send it: ``nav2_simple_commander/robot_navigator.py``, ``_setInitialPose``."""
    message = PoseWithCovarianceStamped(header=HEADER)
    message.pose.pose.position.x = 1.5
    shown = conversion(InitialPose).read(message)
    assert (shown.pose, shown.R[:2], shown.cross) == (Pose(1.5, 0.0, 0.0), (0.25, 0.25), (0.0, 0.0, 0.0))
    assert shown.R[2] == pytest.approx(0.06853891909122467)  # as RViz saves it
    with pytest.raises(ValueError, match="a fix must state positive variances"):
        conversion(Fix).read(message)
    message.pose.covariance[0] = message.pose.covariance[7] = 0.25
    with pytest.raises(ValueError, match="must state the heading's variance"):
        conversion(InitialPose).read(message)


def test_odometry_tells_of_a_speed_to_the_left():
    message = conversion(State).write(State(1.0, 2.0, 0.5, 0.1, 0.2), HEADER)
    message.twist.twist.linear.y = -0.2
    assert conversion(values.Odometry).read(message).across == -0.2
    message.twist.twist.linear.y = math.nan
    with pytest.raises(ValueError, match="the twist"):
        conversion(values.Odometry).read(message)


def test_all_but_the_heading_survives_to_the_bit():
    rng = np.random.default_rng(1)
    for _ in range(100):
        x, y, theta, v, omega = rng.uniform(-3.0, 3.0, 5).tolist()
        pose, state = travel(Pose(x, y, theta)), travel(State(x, y, theta, v, omega))
        assert (pose.x, pose.y) == (x, y)
        assert (state.x, state.y, state.v, state.omega) == (x, y, v, omega)
        assert travel(Command(v, omega)) == Command(v, omega)
        P = a_covariance(rng)
        estimate = travel(Estimate(Belief(State(x, y, theta, v, omega), P), 0.0, 0.0))
        assert travel(Nis(P.xx)) == Nis(P.xx)
        assert travel(Nis(P.xx, P.yy, P.tt)) == Nis(P.xx, P.yy, P.tt)
        assert estimate.belief.covariance == P


def test_a_type_of_ones_own_can_be_registered():
    class Goal(tuple):
        pass

    with pytest.raises(ValueError, match=r"Goal: call register"):
        conversion(Goal)
    register(Goal, PoseStamped, lambda message: Goal(), lambda value, header: PoseStamped(header=header))
    assert conversion(Goal).message is PoseStamped


@pytest.mark.parametrize(
    "value",
    [
        Pose(1.0, math.nan, 0.5),
        State(1.0, 2.0, 0.5, math.nan, 0.2),
        Command(0.1, math.inf),
        Estimate(BELIEF._replace(covariance=P._replace(xx=math.inf)), 0.0, 0.0),
        Nis(math.nan),
    ],
)
def test_a_value_that_is_no_number_is_not_sent(value):
    with pytest.raises(ValueError, match="must be finite"):
        write(value)


def test_a_message_that_is_no_value_is_refused():
    """Also those of `test_messages`, of any content."""
    pose, odometry = write(Pose(1.0, 2.0, 0.3)), write(values.Odometry(Pose(1.0, 2.0, 0.5), Command(0.1, 0.2), True))
    pose.pose.orientation.w = 0.0
    with pytest.raises(ValueError, match="instead of 1"):
        conversion(Pose).read(pose)
    odometry.pose.covariance[0] = math.nan
    with pytest.raises(ValueError, match=r"pose.covariance\[0\] is NaN"):
        conversion(values.Odometry).read(odometry)
    for part, places in (("pose", (0, 7, 35)), ("twist", (0, 35))):
        for at in places:
            message = write(Estimate(BELIEF, 0.0, 0.0))
            getattr(message, part).covariance[at] = -1e-9
            with pytest.raises(ValueError, match="variances must not be negative"):
                conversion(Estimate).read(message)


@pytest.mark.parametrize("beams", [1, 2, 36, 269, 360, 1080])
def test_a_scan_travels_to_the_bit(beams):
    rng = np.random.default_rng(beams)
    single = [float(np.float32(number)) for number in (-1.0, 2.0 * math.pi / beams, 0.12, 3.5, 1e-3, 0.2)]
    for _ in range(20):
        ranges = rng.uniform(0.12, 3.5, beams).astype(np.float32)
        ranges = np.where(rng.random(beams) < 0.2, np.float32(np.inf), np.maximum(ranges, np.float32(0.12)))
        scan = Scan(ranges, *single)
        back = conversion(Scan).read(over_the_wire(conversion(Scan).write(scan, Header())))
        assert back.ranges.dtype == np.float32
        assert back.ranges.tobytes() == ranges.tobytes()
        assert back[1:] == scan[1:]


@pytest.mark.parametrize("distance", [0.25, -0.125, math.inf, 0.0])
def test_a_clearance_travels_and_one_that_is_no_number_is_refused(distance):
    way = conversion(Clearance)
    assert way.read(over_the_wire(way.write(Clearance(distance), Header()))) == Clearance(distance)
    with pytest.raises(ValueError, match="not a number"):
        way.read(way.write(Clearance(math.nan), Header()))


def test_obstacles_travel_as_markers():
    way = conversion(Obstacles)
    room = Obstacles((1.0, -1.0, 2.5, 2.0), ((0.5, 0.25, 0.3), (-1.0, 0.0, 0.1)), ((0.0, 1.0, 0.4, 1.2, 0.7),))
    message = over_the_wire(way.write(room, Header(frame_id="odom")))
    assert [marker.header.frame_id for marker in message.markers] == ["odom"] * 4
    assert len({(marker.ns, marker.id) for marker in message.markers}) == 4
    corners = [(-1.5, -3.0), (3.5, -3.0), (3.5, 1.0), (-1.5, 1.0), (-1.5, -3.0)]
    assert [(point.x, point.y) for point in message.markers[0].points] == corners
    back = way.read(message)
    for read, other in zip(back, room, strict=True):
        np.testing.assert_allclose(read, other, rtol=1e-12)
    message.markers.pop(0)
    with pytest.raises(ValueError, match="no walls"):
        way.read(message)


@pytest.mark.parametrize(("rows", "columns", "resolution", "yaw"), [(1, 1, 0.05, 0.0), (7, 4, 0.1, 0.7), (30, 41, 0.037, -3.1)])
def test_a_map_travels_cell_by_cell(rows, columns, resolution, yaw):
    cells = np.random.default_rng(rows).choice([0, 100, -1, 40], (rows, columns)).astype(np.int8)
    cells[0, 0] = 0
    grid = GridMap(cells=cells, resolution=resolution, origin=Pose(-1.7, 0.3, yaw))
    message = over_the_wire(conversion(GridMap).write(grid, Header(frame_id="odom")))
    back = conversion(GridMap).read(message)
    np.testing.assert_array_equal(back.cells, cells)
    assert (back.resolution, back.origin) == (resolution, grid.origin)
    assert list(message.data) == cells.ravel().tolist()  # row by row from the lowest
