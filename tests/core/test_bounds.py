"""Each field of each parameter class: its default, and the last value that is allowed and the first that is not."""

from __future__ import annotations

import math
import re
from dataclasses import asdict, fields

import pytest

from turtlebot_gym.parameters import FilterTuning, Noise, OdometryNoise, ProcessNoise, Reward

INF, NAN = math.inf, math.nan
LEAST, TINY, ABOVE_ONE, HUGE = 1e-15, 1e-100, 1.0000000000000002, 1e9
TOO_SMALL, TOO_LARGE = (5e-324, 9.9e-101), (math.nextafter(1e9, math.inf), 1e300, 1.7976931348623157e308)
SIZE = "0 or from 1e-100 to 1e+09 in size"
GIVEN = {FilterTuning: {"Q": (0.1,) * 5, "R": (0.2,) * 3}}

# rule: allowed values, refused values, and what the message says
NON_NEGATIVE = ((0.0, TINY, 1, 3.5, HUGE), (-TINY, -1.0, INF, NAN), "non-negative")
PROBABILITY = ((0.0, TINY, 0, 0.5, 1, 1.0), (-TINY, ABOVE_ONE, INF, NAN), "a probability")
FINITE = ((-HUGE, -1.0, 0.0, 1, HUGE), (INF, -INF, NAN), "finite")
POSITIVE = ((LEAST, 1, HUGE), (0.0, -LEAST, INF, NAN), "positive")
WITHOUT_LIMIT = ((LEAST, 1, HUGE, INF), (0.0, -LEAST, NAN), "positive or infinite")
BOUNDS = {
    (ProcessNoise, "alpha1"): NON_NEGATIVE,
    (ProcessNoise, "alpha2"): NON_NEGATIVE,
    (ProcessNoise, "alpha3"): NON_NEGATIVE,
    (ProcessNoise, "alpha4"): NON_NEGATIVE,
    (ProcessNoise, "scale"): POSITIVE,
    (ProcessNoise, "slip"): PROBABILITY,
    (ProcessNoise, "slip_start"): PROBABILITY,
    (ProcessNoise, "slip_end"): PROBABILITY,
    (OdometryNoise, "spike_probability"): PROBABILITY,
    (OdometryNoise, "spike"): NON_NEGATIVE,
    (OdometryNoise, "dropout_probability"): PROBABILITY,
    (FilterTuning, "gate"): WITHOUT_LIMIT,
    (FilterTuning, "max_rejections"): WITHOUT_LIMIT,
    (FilterTuning, "heading_gate"): WITHOUT_LIMIT,
    (FilterTuning, "spike_probability"): PROBABILITY,
    (FilterTuning, "spike"): NON_NEGATIVE,
    (FilterTuning, "scale_deviation"): NON_NEGATIVE,
    (FilterTuning, "kind"): ((0.0, 1.0, 2.0, 3.0, 4.0), (-1.0, 0.5, 5.0, NAN), "one of the kinds in turtlebot_gym.parameters"),
    (Reward, "progress"): FINITE,
    (Reward, "time"): FINITE,
    (Reward, "effort"): FINITE,
    (Reward, "success"): FINITE,
    (Reward, "collision"): FINITE,
    (Reward, "nearness"): FINITE,
    (Reward, "near"): POSITIVE,
}
TUPLES = {
    (OdometryNoise, "bias"): (3, FINITE),
    (OdometryNoise, "quantization"): (2, NON_NEGATIVE),
    (OdometryNoise, "R"): (3, NON_NEGATIVE),
    (FilterTuning, "Q"): (5, NON_NEGATIVE),
    (FilterTuning, "R"): (3, NON_NEGATIVE),
    (FilterTuning, "P0"): (5, NON_NEGATIVE),
}


def make(cls, name, value):
    return cls(**GIVEN.get(cls, {}) | {name: value})


def label(value):
    return f"{value[0].__name__}.{value[1]}" if isinstance(value, tuple) else None


@pytest.mark.parametrize("what", BOUNDS, ids=label)
def test_a_number_has_its_bounds(what):
    cls, name = what
    allowed, refused, rule = BOUNDS[what]
    for value in allowed:
        assert getattr(make(cls, name, value), name) == value
    for value in refused:
        with pytest.raises(ValueError, match=f"^{cls.__name__}.{name} must be {rule}, got {value!r}\\.$"):
            make(cls, name, value)
    if name != "kind":
        size = "from 1e-15 to 1e+09 in size" if rule.startswith("positive") else SIZE
        small = (*TOO_SMALL, 9.99e-16) if rule.startswith("positive") else TOO_SMALL
        for value in (*small, *(() if rule == "a probability" else TOO_LARGE)):
            told = f"{cls.__name__}.{name} must be {size}, got {value!r}."
            with pytest.raises(ValueError, match=f"^{re.escape(told)}$"):
                make(cls, name, value)


@pytest.mark.parametrize("what", TUPLES, ids=label)
def test_each_component_has_its_bounds(what):
    (cls, name), (size, (allowed, refused, _)) = what, TUPLES[what]
    for at in range(size):
        for value in allowed:
            row = tuple(value if k == at else 0.5 for k in range(size))
            assert getattr(make(cls, name, row), name) == row
            assert getattr(make(cls, name, list(row)), name) == row
        for value in (*refused, 5e-324, *TOO_LARGE):
            with pytest.raises(ValueError, match=rf"^{cls.__name__}\.{name} must .*, got .*\.$"):
                make(cls, name, tuple(value if k == at else 0.5 for k in range(size)))


@pytest.mark.parametrize("what", TUPLES, ids=label)
def test_a_tuple_has_its_size(what):
    (cls, name), (size, _) = what, TUPLES[what]
    for wrong in ((0.5,) * (size - 1), (0.5,) * (size + 1), (), 0.5, None):
        with pytest.raises(ValueError, match=rf"^{cls.__name__}\.{name} must .*({size}|sequence of numbers)"):
            make(cls, name, wrong)


def test_every_number_is_listed_above():
    listed = set(BOUNDS) | set(TUPLES)
    for cls in (ProcessNoise, OdometryNoise, FilterTuning, Reward):
        for field in fields(cls):
            assert (cls, field.name) in listed or field.type in ("bool", "ProcessNoise"), (cls, field.name)


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
        "remember_velocity": False,
        "wrap_innovation": True,
        "gate": INF,
        "max_rejections": 10.0,
        "odometry_input": False,
        "kind": 0.0,
        "heading_gate": INF,
        "spike_probability": 0.0,
        "spike": 0.0,
        "scale_deviation": 0.05,
    }
    assert asdict(Reward()) == {
        "progress": 1.0, "time": 0.1, "effort": 0.01, "success": 10.0, "collision": 50.0, "nearness": 0.5, "near": 0.15
    }  # fmt: skip


@pytest.mark.parametrize(
    "value", [ProcessNoise(), OdometryNoise(), Noise(), FilterTuning(Q=(0.1,) * 5, R=(0.2,) * 3), Reward()]
)
def test_parameters_cannot_be_changed_and_take_no_other_fields(value):
    for field in fields(value):
        with pytest.raises(AttributeError):
            setattr(value, field.name, getattr(value, field.name))
    with pytest.raises((AttributeError, TypeError)):
        value.unknown = 1.0
    with pytest.raises(TypeError):  # keywords only
        type(value)(0.1)
