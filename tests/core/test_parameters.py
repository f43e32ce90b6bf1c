"""Bad input is refused with a message that names the parameter."""

from __future__ import annotations

import math
from dataclasses import fields

import gymnasium as gym
import numpy as np
import pytest

import turtlebot_gym
from turtlebot_gym.parameters import FilterTuning, Noise, OdometryNoise, ProcessNoise, Reward
from turtlebot_gym.presets import NOISES, make_filter, make_noise, make_robot, matched
from turtlebot_gym.robots import ROBOTS, Robot
from turtlebot_gym.systems import make_parameters
from turtlebot_gym.tasks import Task

NAN, INF = math.nan, math.inf
NAV, SQUARE = "turtlebot_gym/TurtleBotNav-v0", "turtlebot_gym/TurtleBotSquare-v0"
Q, R = (0.1,) * 5, (0.1,) * 3


def make(cls, name, value):
    required = {"Robot": {"max_linear": 0.2, "max_angular": 2.0}, "FilterTuning": {"Q": Q, "R": R}}
    return cls(**(required.get(cls.__name__, {}) | {name: value}))


NUMBERS = [
    (cls, item.name)
    for cls in (Robot, ProcessNoise, OdometryNoise, FilterTuning, Reward, Task)
    for item in fields(cls)
    if item.type == "float"
]
TUPLES = [(OdometryNoise, "R", 3), (OdometryNoise, "bias", 3), (OdometryNoise, "quantization", 2)]
TUPLES += [(FilterTuning, "Q", 5), (FilterTuning, "R", 3), (FilterTuning, "P0", 5)]


@pytest.mark.parametrize(("cls", "name"), NUMBERS, ids=lambda value: getattr(value, "__name__", value))
@pytest.mark.parametrize("value", [NAN, "fast", None])
def test_no_number_may_be_nan_or_no_number(cls, name, value):
    with pytest.raises(ValueError, match=f"{cls.__name__}.{name} must be"):
        make(cls, name, value)


@pytest.mark.parametrize(("cls", "name", "size"), TUPLES, ids=lambda value: getattr(value, "__name__", value))
def test_no_component_may_be_nan_or_missing(cls, name, size):
    for value in ((*[0.0] * (size - 1), NAN), [0.0] * (size + 1), (*[0.0] * (size - 1), INF)):
        with pytest.raises(ValueError, match=f"{cls.__name__}.{name} must"):
            make(cls, name, value)


NEGATIVE = [(cls, name) for cls, name in NUMBERS if cls not in (Reward,)]


@pytest.mark.parametrize(("cls", "name"), NEGATIVE, ids=lambda value: getattr(value, "__name__", value))
def test_no_size_may_be_negative(cls, name):
    with pytest.raises(ValueError, match=f"{cls.__name__}.{name} must be"):
        make(cls, name, -0.1)


@pytest.mark.parametrize(
    ("cls", "name"),
    [
        *((ProcessNoise, name) for name in ("slip", "slip_start", "slip_end")),
        *((OdometryNoise, name) for name in ("spike_probability", "dropout_probability")),
    ],
)
def test_probabilities_are_at_most_one(cls, name):
    assert getattr(make(cls, name, 1.0), name) == 1.0
    with pytest.raises(ValueError, match=f"{cls.__name__}.{name} must be a probability"):
        make(cls, name, 1.1)


COVARIANCES = [(OdometryNoise, "R", 3), (FilterTuning, "Q", 5), (FilterTuning, "R", 3), (FilterTuning, "P0", 5)]


@pytest.mark.parametrize(("cls", "name", "size"), COVARIANCES, ids=lambda value: getattr(value, "__name__", value))
def test_covariances(cls, name, size):
    where = f"{cls.__name__}.{name} must"
    diagonal = tuple(float(k) for k in range(size))
    for value in (diagonal, list(diagonal), np.array(diagonal), np.diag(diagonal), np.diag(diagonal).tolist()):
        assert getattr(make(cls, name, value), name) == diagonal
    assert getattr(make(cls, name, (0.0,) * size), name) == (0.0,) * size  # zero is allowed
    lopsided, correlated = np.eye(size), np.eye(size)
    lopsided[0, 1] = 0.5
    correlated[0, 1] = correlated[1, 0] = 0.5
    with pytest.raises(ValueError, match=f"{where} be symmetric"):
        make(cls, name, lopsided)
    with pytest.raises(ValueError, match=f"{where} be diagonal"):
        make(cls, name, correlated)
    for bad in (-1e-9, NAN, INF):
        with pytest.raises(ValueError, match=f"{where} hold finite variances"):
            make(cls, name, (*diagonal[:-1], bad))
        with pytest.raises(ValueError, match=where):
            make(cls, name, np.diag((*diagonal[:-1], bad)))
    for shape in (np.eye(size + 1), np.ones((size, size + 1)), 0.5, "abc"):
        with pytest.raises(ValueError, match=where):
            make(cls, name, shape)


@pytest.mark.parametrize("maker", [gym.make, gym.make_vec], ids=["scalar", "vector"])
@pytest.mark.parametrize(
    ("name", "known"),
    [
        ("robot", ["burger", "waffle", "turtlebot4", "tutorial"]),
        ("noise", ["clean", "tutorial", "documented", "wheel", "rough"]),
        ("filter", ["matched", "tutorial", "gated", "mixture", "slip", "scale"]),
        ("integrator", ["euler", "midpoint"]),
        ("observation", ["ekf", "odometry", "truth"]),
        ("arrival", ["truth", "belief"]),
        ("task", ["nav", "pose", "square", "room"]),
    ],
)
def test_unknown_names_are_answered_with_the_known_ones(maker, name, known):
    with pytest.raises(ValueError, match=f"{name} must be one of {', '.join(map(repr, known))}, got 'nonsense'"):
        maker(NAV, **{name: "nonsense"})


@pytest.mark.parametrize(
    ("maker", "options", "message"),
    [
        (gym.make, {"dt": 0.0}, "dt must be positive"),
        (gym.make, {"dt": -0.1}, "dt must be positive"),
        (gym.make, {"dt": NAN}, "dt must be positive"),
        (gym.make_vec, {"dt": INF}, "dt must be positive"),
        (gym.make, {"laps": 0}, "laps must be a whole number of at least 1, got 0"),
        (gym.make, {"switch": "sometimes"}, "switch must be one of 'arrival', 'time', got 'sometimes'"),
        (gym.make, {"waypoints": []}, "waypoints must be"),
        (gym.make, {"waypoints": [(0.0, NAN, 0.0)]}, "waypoints must be"),
        (gym.make_vec, {"num_envs": 0}, "num_envs must be"),
        (gym.make_vec, {"info": "some"}, "info must be one of 'default', 'full', got 'some'"),
        (gym.make_vec, {"autoreset_mode": "later"}, "autoreset_mode must be one of"),
        (gym.make_vec, {"max_episode_steps": 0}, "Task.max_steps must be positive"),
        (gym.make_vec, {"max_episode_steps": -5}, "Task.max_steps must be positive"),
    ],
)
def test_other_bad_arguments_are_named(maker, options, message):
    with pytest.raises(ValueError, match=message):
        maker(SQUARE, **options)


def test_arguments_that_do_not_go_together_are_refused():
    with pytest.raises(ValueError, match="waypoints"):
        gym.make(NAV, waypoints=[(1.0, 0.0, 0.0)])
    with pytest.raises(ValueError, match=r"Task.min_distance must be at most arena"):
        Task(arena=1.0, min_distance=1.5)
    with pytest.raises(ValueError, match=r"Robot.max_linear must be positive, got inf"):
        Robot(max_linear=INF, max_angular=1.0)


def test_values_pass_where_names_do():
    robot, noise, tuning = ROBOTS["waffle"], NOISES["rough"], matched(NOISES["clean"])
    assert (make_robot(robot), make_noise(noise), make_filter(tuning, noise)) == (robot, noise, tuning)
    p = make_parameters(robot=robot, noise=noise, filter=tuning, dt=1)
    assert (p.robot, p.noise, p.tuning, p.dt) == (robot, noise, tuning, 1.0)


@pytest.mark.parametrize("value", [*NOISES.values(), *ROBOTS.values(), matched(Noise()), turtlebot_gym.NAV, Reward()])
def test_parameters_cannot_be_changed(value):
    name = fields(value)[0].name
    with pytest.raises(AttributeError):
        setattr(value, name, 1.0)


def test_infinite_limits_where_they_mean_none():
    assert Robot(max_linear=0.2, max_angular=1.0).max_wheel == INF
    assert Task(max_steps=INF).max_steps == INF
    assert FilterTuning(Q=Q, R=R).gate == INF
