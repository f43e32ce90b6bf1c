"""The Burger in MuJoCo: its parameters check themselves, and it moves as the physics says."""

import math
import sys
from dataclasses import fields, replace
from threading import Thread

import numpy as np
import pytest

from turtlebot_gym.plants import Engine, MujocoBurger, _model_of, engine_of, make_plant
from turtlebot_gym.values import STOP, Command, Pose

BASE = MujocoBurger(friction=0.4, caster_friction=0.2)
"""So slippery that everything counts."""
CHANGES = {
    "friction": 0.5,
    "caster_friction": 0.3,
    "wheel_radius": 0.034,
    "wheel_separation": 0.17,
    "wheel_width": 0.02,
    "cylinders": True,
    "base_mass": 0.9,
    "base_inertia": (3e-3, 2e-3, 2e-3),
    "base_center": (-0.03, 0.0, 0.07),
    "wheel_mass": 0.03,
    "wheel_inertia": (1.2e-5, 2.2e-5, 1.2e-5),
    "lidar_mass": 0.12,
    "caster_mass": 0.006,
    "caster_radius": 0.006,
    "motor_gain": 0.2,
    "motor_torque": 0.05,
    "armature": 0.003,
    "lead": 0.02,
    "reading": 0.01,
    "step": 0.001,
}


def rollout(burger):
    pytest.importorskip("mujoco")
    engine = Engine(burger)
    physics, wheels, before, log = engine.start(Pose(0.0, 0.0, 0.0)), Pose(0.0, 0.0, 0.0), STOP, []
    for command in [Command(0.2, 0.5)] * 4 + [Command(-0.1, -2.0)] * 4:
        driven = engine.drive(physics, wheels, (before, command), 0.1)
        physics, wheels, before = driven.physics, driven.wheels, command
        log.append(driven[:3])
    return log


def test_each_field_changes_a_rollout():
    first = rollout(BASE)
    assert rollout(replace(BASE)) == first
    assert {field.name for field in fields(MujocoBurger)} == set(CHANGES)
    assert [name for name, value in CHANGES.items() if rollout(replace(BASE, **{name: value})) == first] == []


def test_a_control_interval_is_cut_into_whole_steps():
    assert MujocoBurger().steps(0.1) == (50, 20)
    assert MujocoBurger(lead=0.0, step=0.004).steps(0.2) == (50, 0)
    with pytest.raises(ValueError, match="must be multiples of MujocoBurger"):
        MujocoBurger().steps(0.033)
    with pytest.raises(ValueError, match="lead must be shorter than dt"):
        MujocoBurger().steps(0.04)


def test_plants_by_name():
    assert make_plant() == make_plant("unicycle") == ()
    assert make_plant("mujoco") == MujocoBurger()
    assert make_plant({"base": "mujoco", "friction": 0.5, "caster_friction": 0.3}) == MujocoBurger(
        friction=0.5, caster_friction=0.3
    )
    assert make_plant({"base": BASE, "friction": 1.0}) == MujocoBurger(caster_friction=0.2)
    with pytest.raises(ValueError, match="plant must be one of 'unicycle', 'mujoco', got 'gazebo'"):
        make_plant("gazebo")
    with pytest.raises(ValueError, match=r"^plant: what it is based on has no fields, so friction must be left out"):
        make_plant({"base": "unicycle", "friction": 0.5})


mujoco = pytest.importorskip("mujoco")

ORIGIN = Pose(0.0, 0.0, 0.0)
GRIP = MujocoBurger()
SLIPPERY = MujocoBurger(friction=0.5, caster_friction=0.3)
VX, LEFT, RIGHT = 9, 7, 8
"""Places in the physics: positions (7 of the base, 2 wheels) come before speeds."""


def drive(burger, command, seconds, *, start=ORIGIN, first=None):
    """Drive with one command, and return the result."""
    engine = engine_of(burger)
    physics, wheels = engine.start(start) if first is None else first, start
    for _ in range(round(seconds / 0.1)):
        driven = engine.drive(physics, wheels, (command, command), 0.1)
        physics, wheels = driven.physics, driven.wheels
    return driven


def test_it_stands_still_where_it_is_not_driven():
    driven = drive(SLIPPERY, STOP, 30.0, start=Pose(1.0, -2.0, 0.7))
    np.testing.assert_allclose(driven.truth, (1.0, -2.0, 0.7, 0.0, 0.0), atol=2e-5)
    np.testing.assert_allclose(driven.wheels, (1.0, -2.0, 0.7), atol=2e-5)


def test_it_drives_its_distance_and_turns_its_angle():
    """0.2 m/s for 20 s, and 1 rad/s for 3 s: within 1 %, and the wheels know it to 0.3 %."""
    line, turn = drive(GRIP, Command(0.2, 0.0), 20.0), drive(GRIP, Command(0.0, 1.0), 3.0)
    assert line.truth.x == pytest.approx(4.0, rel=0.01)
    assert line.wheels.x == pytest.approx(line.truth.x, rel=0.003)
    assert abs(line.truth.y) < 1e-4
    assert turn.truth.theta == pytest.approx(3.0, rel=0.01)
    assert turn.wheels.theta == pytest.approx(turn.truth.theta, rel=0.003)
    assert math.hypot(*turn.truth[:2]) < 1e-3


def test_on_a_slippery_floor_it_falls_behind_its_wheels():
    """A tenth is lost: far beyond what is lost where it grips."""
    line = drive(SLIPPERY, Command(0.2, 0.0), 20.0)
    assert 0.05 < 1.0 - line.truth.x / line.wheels.x < 0.15
    assert line.wheels.x == pytest.approx(4.0, rel=0.02)


def test_without_friction_its_wheels_turn_and_it_does_not_move():
    driven = drive(MujocoBurger(friction=0.0), Command(0.2, 0.5), 10.0)
    assert math.hypot(*driven.truth[:2]) < 1e-3
    assert driven.wheels.theta == pytest.approx(5.0 - 2.0 * math.pi, rel=0.01)
    assert driven.twist == pytest.approx((0.2, 0.5), rel=0.01)


@pytest.mark.parametrize("friction", [0.02, 0.05, 0.1])
def test_with_locked_wheels_it_slides_as_far_as_coulomb_says(friction):
    """v^2 / (2 mu g): with one coefficient everywhere the loads do not matter. It starts at 0.2 m/s with wheels at rest."""
    burger = MujocoBurger(friction=friction, caster_friction=friction)
    at_rest = engine_of(burger).start(ORIGIN)
    driven = drive(burger, STOP, 3.0, first=(*at_rest[:VX], 0.2, *at_rest[VX + 1 :]))
    assert driven.truth.x == pytest.approx(0.2**2 / (2.0 * friction * 9.81), rel=0.03)


@pytest.mark.parametrize("burger", [GRIP, SLIPPERY], ids=["grip", "slippery"])
def test_left_and_right_are_mirror_images(burger):
    left, right = (drive(burger, Command(0.15, sign * 0.8), 6.0) for sign in (1.0, -1.0))
    mirror = np.array([1.0, -1.0, -1.0, 1.0, -1.0])
    np.testing.assert_allclose(np.array(left.truth) * mirror, right.truth, atol=1e-5)
    np.testing.assert_allclose(np.array(left.wheels) * mirror[:3], right.wheels, atol=1e-5)


def test_where_it_starts_does_not_matter():
    start = Pose(3.0, -1.0, 2.0)
    here, there = (drive(GRIP, Command(0.15, 0.3), 5.0, start=pose) for pose in (ORIGIN, start))
    c, s = math.cos(start.theta), math.sin(start.theta)
    for actual, expected in ((here.truth, there.truth), (here.wheels, there.wheels)):
        x, y = start.x + c * actual[0] - s * actual[1], start.y + s * actual[0] + c * actual[1]
        np.testing.assert_allclose(expected[:2], (x, y), atol=1e-5)
        assert math.remainder(expected[2] - actual[2] - start.theta, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-5)


def test_its_odometry_is_what_its_wheels_have_rolled():
    """Over a whole drive the heading is the difference of the angles times 0.033 / 0.16, and the way their mean times 0.033."""
    turn, line = drive(SLIPPERY, Command(0.1, 0.7), 4.0), drive(SLIPPERY, Command(-0.2, 0.0), 4.0)
    begin = engine_of(SLIPPERY).start(ORIGIN)
    assert turn.wheels.theta == pytest.approx(
        (turn.physics[RIGHT] - begin[RIGHT] - turn.physics[LEFT] + begin[LEFT]) * 0.033 / 0.16, abs=1e-9
    )
    rolled = 0.5 * (line.physics[RIGHT] - begin[RIGHT] + line.physics[LEFT] - begin[LEFT]) * 0.033
    assert line.wheels.x == pytest.approx(rolled, abs=1e-6)
    assert turn.twist == pytest.approx((0.1, 0.7), rel=0.03)


def test_the_caster_carries_what_the_lever_says():
    """0.8257 kg and 0.114 kg at -0.032 m and 0.005 kg at -0.081 m, of 1.0017 kg, on a lever of 0.081 m: 3.69 N of 9.83 N."""
    model = mujoco.MjModel.from_xml_string(_model_of(GRIP))
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 2000)
    force, loads = np.zeros(6), {}
    for at in range(data.ncon):
        mujoco.mj_contactForce(model, data, at, force)
        loads[model.geom(max(data.contact[at].geom)).name] = force[0]
    assert model.body_mass.sum() == pytest.approx(1.00173, abs=1e-4)
    assert loads["left"] == pytest.approx(loads["right"], rel=1e-3)
    assert loads["caster"] == pytest.approx(3.69, rel=0.01)
    assert sum(loads.values()) == pytest.approx(9.827, rel=1e-3)


@pytest.mark.parametrize(
    ("options", "share"), [({}, 0.005), ({"friction": 0.5, "caster_friction": 0.3}, 0.015)], ids=["grip", "slippery"]
)
def test_half_the_time_step_gives_nearly_the_same_drive(options, share):
    coarse, fine = (drive(MujocoBurger(**options, step=step), Command(0.15, 0.4), 8.0).truth for step in (0.002, 0.001))
    assert math.dist(coarse[:2], fine[:2]) < share * 0.15 * 8.0


def test_wheels_that_spin_push_as_newton_and_coulomb_say():
    """The centre of mass is 0.0304 m behind the axle and 0.0885 m high, the caster 0.081 m behind. With an acceleration a the
    caster carries, for each kg, n = (9.81 * 0.0304 + 0.0885 a) / 0.081, the wheels 9.81 - n, and a = 0.1 (9.81 - n) - 0.02 n:
    a = 0.477 m/s^2. The wheels spin from some 10 ms on until the robot is as fast as they are, after 0.42 s,
    and it rocks meanwhile. If the loads did not shift, it would be 0.54 m/s^2."""
    engine, command = engine_of(MujocoBurger(friction=0.1, caster_friction=0.02)), Command(0.2, 0.0)
    first = engine.drive(engine.start(ORIGIN), ORIGIN, (command, command), 0.06)
    second = engine.drive(first.physics, first.wheels, (command, command), 0.3)
    assert first.twist.v == pytest.approx(0.2, rel=0.05)
    assert (second.truth.v - first.truth.v) / 0.3 == pytest.approx(0.477, rel=0.05)


def test_cylinders_scrub_in_a_turn_and_ellipsoids_do_not():
    """Why the wheels are ellipsoids: an arc of 3 m with its odometry, in the share of the turn that is lost."""
    lost = {}
    for cylinders in (False, True):
        driven = drive(MujocoBurger(cylinders=cylinders), Command(0.12, 0.2), 25.0)
        lost[cylinders] = 1.0 - math.remainder(driven.truth.theta - 5.0, 2.0 * math.pi) / 5.0 - 1.0
    assert abs(lost[False]) < 0.01 < 0.05 < abs(lost[True])


def test_what_was_driven_before_or_beside_does_not_matter():
    engine, alone = engine_of(SLIPPERY), drive(SLIPPERY, Command(0.2, 0.7), 3.0)
    physics, wheels, beside = engine.start(ORIGIN), ORIGIN, []

    def disturb():
        for k in range(30):
            beside.append(drive(SLIPPERY, Command(-0.1, 0.1 * k), 0.2))

    other = Thread(target=disturb)
    other.start()
    for _ in range(30):
        driven = engine.drive(physics, wheels, (Command(0.2, 0.7),) * 2, 0.1)
        physics, wheels = driven.physics, driven.wheels
    other.join()
    assert len(beside) == 30
    assert driven == alone


def test_a_command_reaches_the_motors_before_the_intervals_end():
    """40 ms before: the wheels then have it, and the robot is on its way."""
    engine = engine_of(GRIP)
    driven = engine.drive(engine.start(ORIGIN), ORIGIN, (STOP, Command(0.2, 0.0)), 0.1)
    assert driven.twist.v == pytest.approx(0.2, rel=0.1)
    assert 0.001 < driven.truth.x < 0.04 * 0.2
    late = engine_of(MujocoBurger(lead=0.0))
    assert abs(late.drive(late.start(ORIGIN), ORIGIN, (STOP, Command(0.2, 0.0)), 0.1).truth.x) < 1e-6


def test_without_mujoco_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(ImportError, match=r"The plant 'mujoco' needs MuJoCo: pip install .*\[mujoco\]"):
        Engine(GRIP)
