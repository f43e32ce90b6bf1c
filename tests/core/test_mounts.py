"""Where a sensor is, by /tf_static: worked out by hand on a robot with a turned plate."""

import math
from types import SimpleNamespace

import pytest

from turtlebot_gym.mounts import StaticFrames, differ
from turtlebot_gym.values import Pose

LEVEL = (0.0, 0.0, 0.0)


def transform(parent, child, at, roll_pitch_yaw=LEVEL):
    """Return a TransformStamped by the textbook's quaternion of roll, pitch and yaw."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(0.5 * angle), math.sin(0.5 * angle)) for angle in roll_pitch_yaw)
    rotation = SimpleNamespace(
        w=cr * cp * cy + sr * sp * sy,
        x=sr * cp * cy - cr * sp * sy,
        y=cr * sp * cy + sr * cp * sy,
        z=cr * cp * sy - sr * sp * cy,
    )
    return SimpleNamespace(
        header=SimpleNamespace(frame_id=parent),
        child_frame_id=child,
        transform=SimpleNamespace(translation=SimpleNamespace(x=at[0], y=at[1], z=at[2]), rotation=rotation),
    )


def frames(*transforms):
    heard = StaticFrames()
    for transform in transforms:
        heard.hear(SimpleNamespace(transforms=[transform]))
    return heard


BASE = transform("base_footprint", "base_link", (0.0, 0.0, 0.01))
PLATE = transform("base_link", "plate", (-0.1, 0.0, 0.2), (0.0, 0.0, 0.5 * math.pi))
LASER = transform("plate", "laser", (0.03, 0.0, 0.0), (0.0, 0.0, 0.5 * math.pi))


@pytest.mark.parametrize("order", [(BASE, PLATE, LASER), (LASER, PLATE, BASE), (LASER, PLATE, BASE, BASE)])
def test_transforms_add_up_from_the_sensor_to_the_robot(order):
    assert frames(*order).mount("base_footprint", "laser") == pytest.approx((-0.1, 0.03, math.pi))
    assert frames(*order).mount("plate", "base_footprint") == pytest.approx((0.0, -0.1, -0.5 * math.pi))


def test_frames_that_nothing_connects_have_no_mount():
    assert frames(PLATE, LASER).mount("base_footprint", "laser") is None
    assert frames(BASE, PLATE, LASER).mount("robot1/base_footprint", "laser") is None


def test_a_frame_stated_twice_and_a_tilted_one_are_refused():
    moved = transform("base_link", "plate", (-0.2, 0.0, 0.2), (0.0, 0.0, 0.5 * math.pi))
    with pytest.raises(ValueError, match="two different poses of 'plate'"):
        frames(BASE, PLATE, LASER, moved).mount("base_footprint", "laser")
    assert frames(BASE, PLATE, LASER, moved).mount("base_footprint", "base_link") == pytest.approx((0.0, 0.0, 0.0))
    upside_down = transform("plate", "laser", (0.0, 0.0, 0.0), (math.pi, 0.0, 0.0))
    with pytest.raises(ValueError, match="'laser' is tilted by 180 degrees"):
        frames(BASE, PLATE, upside_down).mount("base_footprint", "laser")


def test_a_loop_ends():
    loop = transform("a", "b", (0.0, 0.0, 0.0)), transform("b", "a", (0.0, 0.0, 0.0))
    assert frames(*loop).mount("c", "a") is None


@pytest.mark.parametrize(("other", "expected"), [((0.01, 0.0, 6.3), False), ((0.03, 0.0, 0.0), True), ((0.0, 0.0, 0.1), True)])
def test_poses_differ_by_centimetres_or_degrees(other, expected):
    assert differ(Pose(0.0, 0.0, 0.0), Pose(*other)) is expected
