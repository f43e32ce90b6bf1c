"""Values and messages: what goes over a topic comes back, and what is no pose is refused."""

import math
from array import array

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped, Quaternion, Twist, TwistStamped
from nav_msgs.msg import Odometry
from scipy import stats
from std_msgs.msg import Header

from turtlebot_gym import values
from turtlebot_gym.estimation.ekf import Estimate
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.values import Belief, Command, Covariance, Fix, Pose, State
from turtlebot_gym_ros.node.block import Nis
from turtlebot_gym_ros.node.convert import SURPRISING, conversion, register
from turtlebot_gym_ros.node.geometry import quaternion_of, yaw_of

HEADER = Header(frame_id="odom")


def travel(value):
    way = conversion(type(value))
    return way.read(way.write(value, HEADER))


def a_covariance(rng):
    root = rng.normal(size=(5, 5))
    return Covariance(*(root @ root.T)[np.triu_indices(5)].tolist())


@pytest.mark.parametrize("theta", [0.0, 1e-9, -1e-9, 1e-300, 1.0, -2.0, math.pi / 2, -math.pi, math.nextafter(math.pi, 0.0)])
def test_headings_survive_the_quaternion(theta):
    for _ in range(50):  # and their neighbours
        assert yaw_of(quaternion_of(theta)) == theta
        theta = math.nextafter(theta, 0.0)


def test_any_heading_survives_the_quaternion_to_the_bit():
    rng = np.random.default_rng(0)
    headings = [
        *rng.uniform(-math.pi, math.pi, 20_000),
        *(rng.choice([-1.0, 1.0], 5_000) * 10.0 ** rng.uniform(-300, 0, 5_000)),
    ]
    back = [yaw_of(quaternion_of(float(heading))) for heading in headings]
    assert back == headings
    plain = [2.0 * math.atan2(math.sin(0.5 * heading), math.cos(0.5 * heading)) for heading in headings]
    assert plain != headings  # sine and cosine alone would lose some


def test_a_heading_that_one_unit_in_the_last_place_mends_costs_no_more():
    """Where the cosine alone, moved by one unit, gives the heading back, that is all that is moved."""
    mended = 0
    for heading in np.random.default_rng(3).uniform(-math.pi, math.pi, 5_000).tolist():
        z, w = math.sin(0.5 * heading), math.cos(0.5 * heading)
        up = w + math.ulp(w)
        if 2.0 * math.atan2(z, w) != heading and 2.0 * math.atan2(z, up) == heading:
            q = quaternion_of(heading)
            assert (q.z, q.w) == (z, up)
            mended += 1
    assert mended > 50


def test_a_quaternion_stays_a_rotation_for_other_readers():
    for heading in np.random.default_rng(1).uniform(-math.pi, math.pi, 2_000).tolist():
        q = quaternion_of(heading)
        assert abs(q.z * q.z + q.w * q.w - 1.0) < 1e-14
        general = math.atan2(2.0 * q.w * q.z, 1.0 - 2.0 * q.z * q.z)  # the formula that others use
        assert abs(wrap(general - heading)) < 1e-7 if abs(heading) > 3.14 else abs(general - heading) < 1e-12


@pytest.mark.parametrize(("z", "w"), [(0.6, 0.8), (-0.6, -0.8)])
def test_a_rotation_and_its_negative_are_the_same_heading(z, w):
    assert yaw_of(Quaternion(x=0.0, y=0.0, z=z, w=w)) == pytest.approx(2.0 * math.asin(0.6), abs=1e-12)


@pytest.mark.parametrize("measured", [True, False])
def test_odometry_says_whether_it_was_measured_and_with_which_twist(measured):
    odometry = values.Odometry(Pose(1.0, -2.0, 0.5), Command(0.1, -0.3), measured)
    message = conversion(values.Odometry).write(odometry, HEADER)
    assert message.pose.covariance[0] == (0.0 if measured else -1.0)
    assert (message.twist.twist.linear.x, message.twist.twist.angular.z) == (0.1, -0.3)
    assert travel(odometry) == odometry


@pytest.mark.parametrize("heading", [0.04, math.inf])
def test_a_fix_states_its_variances_and_minus_one_for_a_heading_that_was_not_measured(heading):
    fix = Fix(Pose(1.0, -2.0, 0.5 if heading < math.inf else 0.0), (0.01, 0.02, heading), 0.0, True)
    message = conversion(Fix).write(fix, HEADER)
    assert [message.pose.covariance[at] for at in (0, 7, 35)] == [0.01, 0.02, 0.04 if heading < math.inf else -1.0]
    assert travel(fix) == fix
    if heading == math.inf:
        message.pose.pose.orientation.w = 0.0  # as who measures a position leaves it
        assert conversion(Fix).read(message) == fix


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({0: 0.0}, "positive variances of x and y, got 0 and 0.02"),
        ({7: -1.0}, "positive variances of x and y, got 0.01 and -1"),
        ({7: math.inf}, "positive variances of x and y"),
        ({0: math.nan}, "positive variances of x and y"),
        ({35: 0.0}, "the heading's variance"),
        ({35: math.nan}, "the heading's variance"),
    ],
)
def test_a_fix_without_variances_is_refused(change, told):
    message = conversion(Fix).write(Fix(Pose(1.0, 2.0, 0.5), (0.01, 0.02, 0.03), 0.0, True), HEADER)
    for at, value in change.items():
        message.pose.covariance[at] = value
    with pytest.raises(ValueError, match=told):
        conversion(Fix).read(message)


def test_a_fix_that_is_nowhere_is_refused():
    message = conversion(Fix).write(Fix(Pose(1.0, 2.0, 0.0), (0.01, 0.02, math.inf), 0.0, True), HEADER)
    message.pose.pose.position.x = math.nan
    with pytest.raises(ValueError, match="the pose must be finite"):
        conversion(Fix).read(message)


@pytest.mark.parametrize("variance", [0.0, 1e-6, 100.0])
def test_a_robots_odometry_counts_as_measured(variance):
    message = conversion(State).write(State(1.0, 2.0, 0.5, 0.1, 0.2), HEADER)
    message.pose.covariance[0] = variance
    assert conversion(values.Odometry).read(message) == values.Odometry(Pose(1.0, 2.0, 0.5), Command(0.1, 0.2), True)


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
        kept = {"xx", "xy", "xt", "yy", "yt", "tt", "vv", "vw", "ww"}
        assert travel(Nis(P.xx)) == Nis(P.xx)
        assert estimate.belief.covariance == Covariance(
            *(value if name in kept else 0.0 for name, value in zip(P._fields, P, strict=True))
        )


def test_covariances_are_symmetric_and_lie_where_ros_looks_for_them():
    P = a_covariance(np.random.default_rng(2))
    message = conversion(Estimate).write(Estimate(Belief(State(1.0, 2.0, 0.5, 0.1, 0.2), P), 2.5, 0.0), HEADER)
    pose, twist = (np.reshape(part.covariance, (6, 6)) for part in (message.pose, message.twist))
    assert (pose == pose.T).all()
    assert (twist == twist.T).all()
    x, y, yaw = 0, 1, 5
    assert [pose[x, x], pose[y, y], pose[yaw, yaw]] == [P.xx, P.yy, P.tt]
    assert [pose[x, y], pose[x, yaw], pose[y, yaw]] == [P.xy, P.xt, P.yt]
    assert [twist[x, x], twist[x, yaw], twist[yaw, yaw]] == [P.vv, P.vw, P.ww]
    assert message.twist.twist.linear.x == 0.1  # forward speed, in the body frame


def test_the_innovation_is_no_variance_and_has_a_message_of_its_own():
    estimate = Estimate(Belief(State(0.0, 0.0, 0.0, 0.0, 0.0), Covariance(*[0.1] * 15)), 4.0, 0.0)
    message = conversion(Estimate).write(estimate, HEADER)
    assert 4.0 not in {*message.pose.covariance, *message.twist.covariance}
    assert conversion(Estimate).read(message).nis == 0.0
    message = conversion(Nis).write(Nis(4.0), HEADER)
    assert (message.header, message.status[0].hardware_id, message.status[0].level) == (HEADER, "odom", DiagnosticStatus.OK)
    assert conversion(Nis).write(Nis(30.0), HEADER).status[0].level == DiagnosticStatus.WARN


@pytest.mark.parametrize("text", ["nan", "inf", "", "much"])
def test_an_innovation_that_is_no_number_is_refused(text):
    message = conversion(Nis).write(Nis(1.0), HEADER)
    message.status[0].values[0].value = text
    with pytest.raises(ValueError, match="the NIS must be a finite number"):
        conversion(Nis).read(message)
    message.status[0].values.clear()
    with pytest.raises(ValueError, match="one value named 'nis', but has 0"):
        conversion(Nis).read(message)
    with pytest.raises(ValueError, match="the NIS must be finite, got nan"):
        conversion(Nis).write(Nis(math.nan), HEADER)


def test_a_warning_comes_once_in_a_thousand_measurements():
    assert stats.chi2.sf(SURPRISING, 3) == pytest.approx(1e-3, rel=0.01)


@pytest.mark.parametrize(
    "q",
    [(0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 2.0), (0.0, 0.0, 0.0, 0.9), (0.0, 0.0, math.nan, 1.0), (0.0, 0.0, math.inf, 1.0)],
)
def test_what_is_no_rotation_is_refused(q):
    x, y, z, w = q
    with pytest.raises(ValueError, match="quaternion"):
        yaw_of(Quaternion(x=x, y=y, z=z, w=w))


def test_a_tilted_robot_keeps_its_heading():
    # 0.1 rad of roll after 1 rad of yaw: q = q_yaw * q_roll.
    c, s, cr, sr = math.cos(0.5), math.sin(0.5), math.cos(0.05), math.sin(0.05)
    assert yaw_of(Quaternion(x=c * sr, y=s * sr, z=s * cr, w=c * cr)) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize(
    "value", [Pose(1.0, 2.0, 0.3), State(1.0, 2.0, 0.3, 0.1, 0.2), Command(0.1, 0.2)], ids=lambda value: type(value).__name__
)
def test_nothing_but_numbers_travels(value, bad):
    way = conversion(type(value))
    for at in range(len(value)):
        with pytest.raises(ValueError, match="finite"):
            way.write(type(value)(*(bad if k == at else number for k, number in enumerate(value))), HEADER)
    message = way.write(value, HEADER)
    part = message.twist if type(value) is Command else message.pose.pose if type(value) is State else message.pose
    vector = part.linear if type(value) is Command else part.position
    vector.x = bad
    with pytest.raises(ValueError, match="finite"):
        way.read(message)


def test_covariances_that_are_none_are_refused():
    way = conversion(Belief)
    message = way.write(Belief(State(0.0, 0.0, 0.0, 0.0, 0.0), Covariance(*[0.1] * 15)), HEADER)
    message.pose.covariance[0] = -0.1
    with pytest.raises(ValueError, match="negative"):
        way.read(message)
    message.pose.covariance[0] = math.nan
    with pytest.raises(ValueError, match="finite"):
        way.read(message)


def test_an_odometry_that_states_no_covariance_is_understood():
    message = Odometry(header=HEADER)  # as a TurtleBot3 sends it: 36 zeros
    message.pose.pose.orientation.w = 1.0
    assert message.pose.covariance.tolist() == array("d", [0.0] * 36).tolist()
    assert conversion(State).read(message) == State(0.0, 0.0, 0.0, 0.0, 0.0)


def test_velocities_travel_stamped_or_not():
    assert conversion(Command).message is TwistStamped
    assert conversion(Command, stamped=False).message is Twist
    way = conversion(Command, stamped=False)
    assert way.read(way.write(Command(0.1, -0.2), HEADER)) == Command(0.1, -0.2)


def test_a_type_of_ones_own_can_be_registered():
    class Goal(tuple):
        pass

    with pytest.raises(ValueError, match=r"Goal: call register"):
        conversion(Goal)
    register(Goal, PoseStamped, lambda message: Goal(), lambda value, header: PoseStamped(header=header))
    assert conversion(Goal).message is PoseStamped
