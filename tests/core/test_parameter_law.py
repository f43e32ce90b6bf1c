"""The law of parameters: whatever a user can set changes what an environment does, or is listed here with the reason.

A parameter that nothing read once passed every test of its own, was randomized in training and stood in the documentation.
"""

import math
from contextlib import suppress
from dataclasses import fields, replace
from functools import cache

import numpy as np
import pytest
from own_parts import slide

from turtlebot_gym import FixNoise, Noise, OdometryNoise, ProcessNoise
from turtlebot_gym.envs.navigation import NavigationEnv
from turtlebot_gym.estimation.gyro import Gyro
from turtlebot_gym.heart import Episode
from turtlebot_gym.observations import Observation
from turtlebot_gym.parameters import DeadReckoning, FilterTuning, Gated, Kalman
from turtlebot_gym.presets import matched
from turtlebot_gym.rewards import ON_GROUND, default_weights
from turtlebot_gym.robots import LidarMount, Robot
from turtlebot_gym.systems import Options, Parameters, system_of
from turtlebot_gym.systems.sensors import ImuNoise
from turtlebot_gym.tasks import Task
from turtlebot_gym.values import Pose

STEPS = 240

# Everything is in force, so that a change of any number has something to act on.
ROBOT = Robot(max_linear=0.25, max_angular=2.0, wheel_separation=0.2, max_wheel=0.24, max_linear_acceleration=0.4)
ROBOT = replace(ROBOT, max_angular_acceleration=3.0)
PROCESS = ProcessNoise(alpha1=0.01, alpha2=0.002, alpha3=0.03, alpha4=0.01, scale=1.03, turn_scale=0.9, veer=0.05)
PROCESS = replace(PROCESS, slip=0.4, slip_start=0.1, slip_end=0.3)
SPIKES = {"spike_probability": 0.1, "spike": 0.4, "dropout_probability": 0.1}
ODOMETRY = OdometryNoise(R=(0.01, 0.02, 0.03), bias=(0.03, -0.02, 0.04), **SPIKES)
LEAPING = replace(ODOMETRY, wheel=True, leap_probability=0.1, leap=0.3, leap_turn=0.4)
LEAPING = replace(LEAPING, reset_probability=0.05, reverse_probability=0.4)
GATE = {"gate": 6.0, "max_rejections": 2}
NOISE = Noise(process=PROCESS, odometry=ODOMETRY)
TUNING = replace(matched(NOISE), Q=(1e-4, 2e-4, 3e-4, 1e-3, 2e-3), kind=Kalman(**GATE), from_origin=True)
TASK = Task(random=False, radius=0.35, heading_tolerance=1.5, turn_tolerance=1.9, laps=2, max_steps=200.0)
FIX = FixNoise(R=(0.02, 0.03, 0.04), period=0.3, delay=0.2, dropout_probability=0.1)
IMU = ImuNoise(variance=1e-4, bias_deviation=0.05, bias_walk=0.01)
POSE = (Pose(0.6, 0.1, 0.2), Pose(0.7, 0.8, 1.5), Pose(0.0, 0.6, 3.0))
BASE = Parameters(ROBOT, NOISE, TUNING, TASK, default_weights(ON_GROUND), 0.1, 0.5, 0.0, 1.0)


def of_filter(value):
    return BASE._replace(tuning=replace(TUNING, kind=value))


# For each class how its values get into the parameters, and values in force: in one of them at least each field counts.
LAW = {
    Robot: (lambda value: BASE._replace(robot=value), ROBOT),
    ProcessNoise: (lambda value: BASE._replace(noise=replace(NOISE, process=value)), PROCESS),
    OdometryNoise: (lambda value: BASE._replace(noise=replace(NOISE, odometry=value)), ODOMETRY, LEAPING),
    FilterTuning: (lambda value: BASE._replace(tuning=value), TUNING),
    Kalman: (of_filter, TUNING.kind, Kalman(**GATE, lockout=0.5)),
    DeadReckoning: (
        lambda value: of_filter(value)._replace(noise=Noise(process=PROCESS, odometry=LEAPING)),
        DeadReckoning(leap=0.05, leap_turn=0.5),
        DeadReckoning(leap=0.5, leap_turn=0.05),
    ),
    Gated: (of_filter, Gated(heading_gate=0.3, **GATE), Gated(heading_gate=0.3, **GATE, lockout=0.5)),
    Gyro: (
        lambda value: of_filter(value)._replace(imu=IMU),
        *(Gyro(variance=1e-4, bias_deviation=0.05, bias_walk=0.01, **GATE, lockout=lockout) for lockout in (0.0, 0.5)),
    ),
    Task: (lambda value: BASE._replace(task=value), TASK, Task(radius=0.3), replace(TASK, on_belief=True)),
    ImuNoise: (lambda value: BASE._replace(imu=value), IMU),
    FixNoise: (lambda value: BASE._replace(fix=value), FIX),
}
EXCEPTIONS = {
    (Robot, "radius"): "Open ground has nothing to collide with: see tests/rooms/test_rooms.py.",
    (Robot, "footprint_x"): "Only the collision monitor of a robot reads it: see tests/guard/test_collision.py.",
    (Robot, "lidar"): "Only the collision monitor of a robot reads it: see tests/guard/test_collision.py.",
    (Task, "patience"): "Only goals in a room that are drawn in turn are given up: see tests/rooms/test_missions.py.",
    (Task, "start_known"): "Only a robot that localizes itself has to know where it starts: see the option start, below.",
}

CASES = [(owner, item.name) for owner in LAW for item in fields(owner) if (owner, item.name) not in EXCEPTIONS]


def others(value):
    """Yield other values for a field, by the type of its value; some may break its rule."""
    if isinstance(value, bool):
        yield not value
    elif isinstance(value, (int, float)):
        yield from (3 * value, type(value)(0.5 * value), value + 1, 0.4 * value + 0.2) if value < math.inf else (0.5, 5.0, 20.0)
    elif isinstance(value, tuple):
        yield from ((*value[:-1], other) for other in others(value[-1]))
        yield (0.01, *value[1:])
    else:
        yield from (DeadReckoning(), ProcessNoise(alpha1=0.3), LidarMount(frame="laser", x=0.1))


def changed(owner, name):
    """Yield parameters, and the same with another value of a field."""
    place, *bases = LAW[owner]
    for base in bases:
        for other in others(getattr(base, name)):
            with suppress(ValueError):
                yield place(base), place(replace(base, **{name: other}))


def drive(episode):
    """Return the action of a simple law, forwards or backwards, that is often at a limit."""
    o = Observation(*episode.observe())
    direction = -1.0 if o.cos_bearing < -0.2 else 1.0
    return direction * (0.3 + 0.7 * o.cos_bearing**2), 1.5 * math.atan2(direction * o.sin_bearing, direction * o.cos_bearing)


@cache
def rollout(p):
    """Return all that an environment in plain Python shows, judges and is, over some episodes."""
    episode = Episode(p, POSE, seed=2)
    log = [(episode.world, episode.observe())]
    for _ in range(STEPS):
        outcome = episode.act(drive(episode))
        log.append((episode.world, episode.observe(), outcome))
        if outcome.terminated or outcome.truncated:
            log.append(episode.reset())
    return log


@pytest.mark.parametrize(("owner", "name"), CASES, ids=lambda value: value if isinstance(value, str) else value.__name__)
def test_each_field_changes_a_rollout(owner, name):
    assert any(rollout(before) != rollout(after) for before, after in changed(owner, name)), "it changes nothing"


NEAR = Task(radius=3.0, laps=3)
LOCALIZED = {"task": "room", "noise": "wheel", "localizer": "match"}
ARGUMENTS = {
    "task": ({}, {"task": "pose"}),
    "robot": ({}, {"robot": "waffle"}),
    "noise": ({}, {"noise": "documented"}),
    "filter": ({}, {"filter": "tutorial"}),
    "integrator": ({}, {"integrator": "midpoint"}),
    "observation": ({}, {"observation": "odometry"}),
    "reward": ({}, {"reward": {"time": 0.3}}),
    "arrival": ({}, {"arrival": "belief"}),
    "switch": ({"task": "square"}, {"task": "square", "switch": "time"}),
    "laps": ({"task": "square"}, {"task": "square", "laps": 2}),
    "waypoints": ({"task": "square"}, {"task": "square", "waypoints": [Pose(0.5, 0.0, 0.0), Pose(1.0, 0.5, 0.0)]}),
    "dt": ({}, {"dt": 0.2}),
    "delay": ({}, {"delay": 1}),
    "fix": ({}, {"fix": "beacons"}),
    "imu": ({"filter": "gyro", "imu": "mpu9250"}, {"filter": "gyro", "imu": "calibrated"}),
    "localizer": ({"task": "room", "noise": "wheel"}, LOCALIZED),
    "start": (LOCALIZED, LOCALIZED | {"start": "unknown"}),
    "goals": ({"task": NEAR, "world": "clutter"}, {"task": NEAR, "world": "clutter", "goals": 1}),
    "system": ({}, {"system": lambda p: system_of(p)._replace(move=slide)}),
    "world": ({"task": "room"}, {"task": "room", "world": "office"}),
    "lidar": ({"task": "room"}, {"task": "room", "lidar": "a1"}),
}


def drive_of(**options):
    """Return observations and rewards of a drive with the bearing's simple law, up to its end."""
    env = NavigationEnv(**options)
    observation, _ = env.reset(seed=4)
    log, ended = [observation.tolist()], False
    while not ended and len(log) < 550:
        action = np.array([observation[1], 1.2 * math.atan2(observation[2], observation[1])], np.float32)
        observation, reward, ended, *_ = env.step(action)
        log.append([*observation.tolist(), reward])
    return log


@pytest.mark.parametrize("name", ARGUMENTS)
def test_each_option_changes_a_rollout(name):
    before, after = ARGUMENTS[name]
    assert drive_of(**before) != drive_of(**after)


def test_each_option_is_in_the_table():
    assert set(ARGUMENTS) == {item.name for item in fields(Options)}
