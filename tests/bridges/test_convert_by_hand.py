"""Values and messages, field by field, with literal numbers."""

import math
import re

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, Quaternion, Twist, TwistStamped
from nav_msgs.msg import Odometry
from std_msgs.msg import Header

from turtlebot_gym import values
from turtlebot_gym.estimation.ekf import Estimate
from turtlebot_gym.values import Belief, Command, Covariance, Pose, State
from turtlebot_gym_ros.node.convert import conversion, state_covariance
from turtlebot_gym_ros.node.geometry import quaternion_of, yaw_of

HEADER = Header(frame_id="odom")
X, Y, Z, ROLL, PITCH, YAW = range(6)
P = Covariance(
    xx=0.11, xy=0.12, xt=0.13, xv=0.14, xw=0.15,
    yy=0.22, yt=0.23, yv=0.24, yw=0.25,
    tt=0.33, tv=0.34, tw=0.35,
    vv=0.44, vw=0.45,
    ww=0.55,
)  # fmt: skip
BELIEF = Belief(State(1.0, 2.0, math.pi / 3.0, 0.4, -0.5), P)


def write(value, **options):
    return conversion(type(value), **options).write(value, HEADER)


def filled(message, **places):
    """Set places of the covariances of an odometry: ``pose_14=1.0``."""
    for place, number in places.items():
        part, _, at = place.partition("_")
        getattr(message, part).covariance[int(at)] = number
    return message


def test_a_pose_field_by_field():
    message = write(Pose(1.5, -2.5, math.pi / 3.0))
    assert type(message) is PoseStamped
    assert message.header.frame_id == "odom"
    assert (message.pose.position.x, message.pose.position.y, message.pose.position.z) == (1.5, -2.5, 0.0)
    q = message.pose.orientation  # a turn of 60 degrees: the half is 30 degrees
    assert (q.x, q.y, q.z, q.w) == pytest.approx((0.0, 0.0, 0.5, 0.8660254037844386))


def test_a_command_field_by_field():
    stamped, bare = write(Command(0.2, -0.7)), write(Command(0.2, -0.7), stamped=False)
    assert (type(stamped), type(bare)) == (TwistStamped, Twist)
    assert stamped.header.frame_id == "odom"
    for twist in (stamped.twist, bare):
        assert (twist.linear.x, twist.linear.y, twist.linear.z) == (0.2, 0.0, 0.0)
        assert (twist.angular.x, twist.angular.y, twist.angular.z) == (0.0, 0.0, -0.7)


def test_a_state_field_by_field():
    message = write(BELIEF.mean)
    assert type(message) is Odometry
    assert message.header.frame_id == "odom"
    assert (message.pose.pose.position.x, message.pose.pose.position.y) == (1.0, 2.0)
    assert message.pose.pose.orientation.z == pytest.approx(0.5)
    assert (message.twist.twist.linear.x, message.twist.twist.angular.z) == (0.4, -0.5)


@pytest.mark.parametrize("value", [BELIEF, Estimate(BELIEF, 0.0, 2.0)], ids=["belief", "estimate"])
def test_the_covariances_of_a_message_place_by_place(value):
    message = write(value)
    pose, twist = np.zeros((6, 6)), np.zeros((6, 6))
    pose[X, X], pose[Y, Y], pose[YAW, YAW] = 0.11, 0.22, 0.33
    pose[X, Y] = pose[Y, X] = 0.12
    pose[X, YAW] = pose[YAW, X] = 0.13
    pose[Y, YAW] = pose[YAW, Y] = 0.23
    twist[X, X], twist[YAW, YAW] = 0.44, 0.55
    twist[X, YAW] = twist[YAW, X] = 0.45
    for part, unknown in ((pose, (Z, ROLL, PITCH)), (twist, (Y, Z, ROLL, PITCH))):
        for at in unknown:
            part[at, at] = -1.0  # not known, instead of 0, which would be certain
    np.testing.assert_array_equal(np.reshape(message.pose.covariance, (6, 6)), pose)
    np.testing.assert_array_equal(np.reshape(message.twist.covariance, (6, 6)), twist)


def test_a_message_is_read_place_by_place():
    message = write(BELIEF)
    got = conversion(Belief).read(message)
    assert got.mean == pytest.approx(BELIEF.mean)
    assert got.covariance == P._replace(xv=0.0, xw=0.0, yv=0.0, yw=0.0, tv=0.0, tw=0.0)
    assert conversion(State).read(message) == pytest.approx(BELIEF.mean)
    estimate = conversion(Estimate).read(message)
    assert (estimate.belief, estimate.rejections) == (got, 0.0)


@pytest.mark.parametrize("place", ["pose_14", "pose_21", "pose_28", "twist_7", "twist_14", "twist_21", "twist_28"])
@pytest.mark.parametrize("number", [0.0, 1e6])
def test_what_another_filter_says_of_what_a_planar_robot_does_not_know_changes_nothing(place, number):
    got, other = (conversion(Estimate).read(each) for each in (write(BELIEF), filled(write(BELIEF), **{place: number})))
    assert got == other


@pytest.mark.parametrize("measured", [True, False])
def test_a_covariance_that_is_stated_beside_a_value_place_by_place(measured):
    message = conversion(values.Odometry).write(values.Odometry(Pose(1.0, 2.0, 0.5), Command(0.1, 0.2), measured), HEADER)
    state_covariance(message, P)
    pose, twist = (np.reshape(part.covariance, (6, 6)) for part in (message.pose, message.twist))
    assert np.diag(twist).tolist() == [0.44, -1.0, -1.0, -1.0, -1.0, 0.55]
    if measured:
        assert np.diag(pose).tolist() == [0.11, 0.22, -1.0, -1.0, -1.0, 0.33]
        assert (pose[X, Y], pose[YAW, X], pose[Y, YAW]) == (0.12, 0.13, 0.23)
    else:
        np.testing.assert_array_equal(pose, -np.eye(6))
    assert conversion(values.Odometry).read(message).measured is measured


@pytest.mark.parametrize("place", ["pose_0", "pose_7", "pose_35", "twist_0", "twist_35"])
def test_no_variance_may_be_negative(place):
    conversion(Belief).read(filled(write(BELIEF), **{place: 0.0}))
    with pytest.raises(ValueError, match=r"variances must not be negative, got .*-1e-09"):
        conversion(Belief).read(filled(write(BELIEF), **{place: -1e-9}))


@pytest.mark.parametrize("at", range(36))
@pytest.mark.parametrize("part", ["pose", "twist"])
def test_no_place_may_hold_what_is_no_number(part, at):
    for wrong in (math.nan, math.inf, -math.inf):
        with pytest.raises(ValueError, match="the covariance must be finite"):
            conversion(Belief).read(filled(write(BELIEF), **{f"{part}_{at}": wrong}))


def test_the_refusal_says_what_was_got():
    with pytest.raises(ValueError, match=re.escape("the pose must be finite, got 1, nan, 0.5")):
        write(Pose(1.0, math.nan, 0.5))
    with pytest.raises(ValueError, match=re.escape("the twist must be finite, got inf, 0.25")):
        write(Command(math.inf, 0.25))
    with pytest.raises(ValueError, match=re.escape("variances must not be negative, got -1, 0.22, 0.33, 0.44, 0.55")):
        conversion(Belief).read(filled(write(BELIEF), pose_0=-1.0))
    with pytest.raises(ValueError, match="the covariance must be finite"):
        write(Belief(BELIEF.mean, P._replace(vw=math.nan)))
    with pytest.raises(ValueError, match="the covariance must be finite"):
        write(Estimate(BELIEF._replace(covariance=P._replace(xx=math.inf)), 0.0, 0.0))
    with pytest.raises(ValueError, match=r"No message is known for values of type int: call register\(\.\.\.\) first\."):
        conversion(int)
    with pytest.raises(ValueError, match=re.escape("the quaternion (0.0, 0.5, 0.0, 0.0) has norm 0.5 instead of 1")):
        yaw_of(Quaternion(x=0.0, y=0.5, z=0.0, w=0.0))


@pytest.mark.parametrize("norm", [0.9901, 0.999, 1.0, 1.001, 1.0099])
def test_a_norm_may_be_off_by_less_than_one_percent(norm):
    for axis in ("x", "y", "z", "w"):
        yaw_of(Quaternion(**{"x": 0.0, "y": 0.0, "z": 0.0, "w": 0.0, axis: norm}))


@pytest.mark.parametrize("norm", [0.0, 0.9899, 1.0101, 2.0, -2.0])
def test_a_norm_that_is_off_by_more_is_refused(norm):
    for axis in ("x", "y", "z", "w"):
        with pytest.raises(ValueError, match="instead of 1"):
            yaw_of(Quaternion(**{"x": 0.0, "y": 0.0, "z": 0.0, "w": 0.0, axis: norm}))


@pytest.mark.parametrize(
    ("z", "w", "yaw"),
    [
        (0.0, 1.0, 0.0),
        (0.5, 0.8660254037844386, math.pi / 3.0),
        (-0.5, 0.8660254037844386, -math.pi / 3.0),
        (0.7071067811865476, 0.7071067811865476, math.pi / 2.0),
        (0.8660254037844386, 0.5, 2.0 * math.pi / 3.0),
        (-0.8660254037844386, -0.5, 2.0 * math.pi / 3.0),  # the same rotation
        (1.0, 0.0, -math.pi),  # half a turn is -pi, never pi
        (-1.0, 0.0, -math.pi),
    ],
)
def test_headings_of_well_known_rotations(z, w, yaw):
    assert yaw_of(Quaternion(x=0.0, y=0.0, z=z, w=w)) == pytest.approx(yaw, abs=1e-12)


def test_a_heading_is_read_from_a_tilted_robot():
    # 90 degrees of yaw, then 60 degrees of pitch: q = (cos 45, 0, 0, sin 45) * (cos 30, 0, sin 30, 0), w first.
    c, s = 0.7071067811865476, 0.7071067811865476
    cp, sp = 0.8660254037844386, 0.5
    assert yaw_of(Quaternion(x=-s * sp, y=c * sp, z=s * cp, w=c * cp)) == pytest.approx(math.pi / 2.0, abs=1e-12)


def test_a_rotation_about_the_vertical_by_hand():
    q = quaternion_of(-2.0 * math.pi / 3.0)
    assert (q.x, q.y, q.z, q.w) == pytest.approx((0.0, 0.0, -0.8660254037844386, 0.5))


def test_what_is_stated_in_the_world_is_known():
    assert {kind.__name__: conversion(kind).in_world for kind in (Pose, State, Belief, Estimate, Command)} == {
        "Pose": True,
        "State": True,
        "Belief": True,
        "Estimate": True,
        "Command": False,
    }
    assert conversion(Command, stamped=False).in_world is False
    assert conversion(Pose, stamped=False) == conversion(Pose)
