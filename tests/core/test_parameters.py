"""Bad input is refused with a message that names the parameter."""

from __future__ import annotations

import math
from dataclasses import asdict

import gymnasium as gym
import pytest

from turtlebot_gym.parameters import FilterTuning, Gated, Noise, OdometryNoise, ProcessNoise, Reward, RoomReward, Scale
from turtlebot_gym.presets import NOISES, make_filter, make_noise, make_robot, matched
from turtlebot_gym.robots import ROBOTS, Robot
from turtlebot_gym.systems import make_parameters
from turtlebot_gym.tasks import Task

NAN, INF = math.nan, math.inf
NAV, SQUARE = "turtlebot_gym/TurtleBotNav-v0", "turtlebot_gym/TurtleBotSquare-v0"
Q, R = (0.1,) * 5, (0.1,) * 3


def test_arguments_that_do_not_go_together_are_refused():
    with pytest.raises(ValueError, match="waypoints"):
        gym.make(NAV, waypoints=[(1.0, 0.0, 0.0)])
    with pytest.raises(ValueError, match=r"Task.min_distance must be at most arena"):
        Task(arena=1.0, min_distance=1.5)
    with pytest.raises(ValueError, match=r"Robot.max_linear must be a positive number .*, got inf"):
        Robot(max_linear=INF, max_angular=1.0)


def test_values_pass_where_names_do():
    robot, noise, tuning = ROBOTS["waffle"], NOISES["rough"], matched(NOISES["clean"])
    assert (make_robot(robot), make_noise(noise), make_filter(tuning, noise)) == (robot, noise, tuning)
    p = make_parameters(robot=robot, noise=noise, filter=tuning, dt=1)
    assert (p.robot, p.noise, p.tuning, p.dt) == (robot, noise, tuning, 1.0)


def test_infinite_limits_where_they_mean_none():
    assert Robot(max_linear=0.2, max_angular=1.0).max_wheel == INF
    assert Task(max_steps=INF).max_steps == INF
    assert FilterTuning(Q=Q, R=R).kind.gate == INF


def test_the_defaults_are_no_noise():
    assert asdict(ProcessNoise()) == {
        "alpha1": 0.0, "alpha2": 0.0, "alpha3": 0.0, "alpha4": 0.0,
        "scale": 1.0, "slip": 0.0, "slip_start": 0.0, "slip_end": 1.0,
    }  # fmt: skip
    assert asdict(OdometryNoise()) == {
        "R": (0.0, 0.0, 0.0),
        "bias": (0.0, 0.0, 0.0),
        "spike_probability": 0.0,
        "spike": 0.0,
        "dropout_probability": 0.0,
        "quantization": (0.0, 0.0),
        "wheel": False,
    }
    assert Noise() == Noise(process=ProcessNoise(), odometry=OdometryNoise())


def test_the_defaults_of_a_filter_and_of_the_reward():
    tuning = asdict(FilterTuning(Q=(0.1, 0.2, 0.3, 0.4, 0.5), R=(0.6, 0.7, 0.8)))
    assert tuning.pop("process") == asdict(ProcessNoise())
    assert tuning == {
        "Q": (0.1, 0.2, 0.3, 0.4, 0.5),
        "R": (0.6, 0.7, 0.8),
        "from_origin": False,
        "P0": (0.1, 0.1, 0.1, 1.0, 1.0),
        "kind": {"remember_velocity": False, "wrap_innovation": True, "gate": INF, "max_rejections": 10},
    }
    assert (Gated(heading_gate=6.0).max_rejections, Scale().scale_deviation) == (10, 0.05)
    weights = {"progress": 1.0, "time": 0.1, "effort": 0.01, "success": 10.0}
    assert asdict(Reward()) == weights
    assert asdict(RoomReward()) == weights | {"collision": 50.0, "nearness": 0.5, "near": 0.15}


def test_weights_for_rooms_are_refused_on_open_ground_and_completed_in_rooms():
    assert make_parameters("room", reward=Reward(time=0.3)).reward == RoomReward(time=0.3)
    assert make_parameters("room", reward={"collision": 9.0}).reward == RoomReward(collision=9.0)
    with pytest.raises(ValueError, match="reward must be a Reward on open ground"):
        make_parameters(reward=RoomReward())
    with pytest.raises(ValueError, match="reward: Reward has no collision"):
        make_parameters(reward={"collision": 9.0})
