"""The Burger's parameters: they check themselves, and each of them moves the robot."""

from dataclasses import fields, replace

import pytest

from turtlebot_gym.plants import MujocoBurger, make_plant
from turtlebot_gym.plants.engine import Engine
from turtlebot_gym.values import STOP, Command, Pose

BASE = MujocoBurger(friction=0.4, caster_friction=0.2)
"""So slippery that everything counts."""
CHANGES = {
    "friction": 0.5, "caster_friction": 0.3, "wheel_radius": 0.034, "wheel_separation": 0.17, "wheel_width": 0.02,
    "cylinders": True, "base_mass": 0.9, "base_inertia": (3e-3, 2e-3, 2e-3), "base_center": (-0.03, 0.0, 0.07),
    "wheel_mass": 0.03, "wheel_inertia": (1.2e-5, 2.2e-5, 1.2e-5), "lidar_mass": 0.12, "caster_mass": 0.006,
    "caster_radius": 0.006, "motor_gain": 0.2, "motor_torque": 0.05, "armature": 0.003, "lead": 0.02, "reading": 0.01,
    "step": 0.001,
}  # fmt: skip


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
    assert make_plant("mujoco", friction=0.5, caster_friction=0.3) == MujocoBurger(friction=0.5, caster_friction=0.3)
    assert make_plant(BASE, friction=1.0) == MujocoBurger(caster_friction=0.2)
    with pytest.raises(ValueError, match="plant must be one of 'unicycle', 'mujoco', got 'gazebo'"):
        make_plant("gazebo")
    with pytest.raises(ValueError, match="friction and caster_friction are for the plant 'mujoco', not for 'unicycle'"):
        make_plant("unicycle", friction=0.5)
