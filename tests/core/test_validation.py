"""The one rule for what users pass: what each kind of rule accepts, its sentence of refusal, and which field has which rule."""

import math
import re
from dataclasses import dataclass, fields
from fractions import Fraction
from typing import Annotated

import numpy as np
import pytest

from turtlebot_gym import FixNoise, Noise, OdometryNoise, ProcessNoise, Robot, Task
from turtlebot_gym.parameters import FilterTuning, Gated, Kalman
from turtlebot_gym.plants import MujocoBurger
from turtlebot_gym.rooms.lidar import Lidar
from turtlebot_gym.rooms.rules import RoomRules
from turtlebot_gym.validation import (
    FINITE,
    NON_NEGATIVE,
    POSITIVE,
    POSITIVE_OR_INFINITE,
    PROBABILITY,
    Numbers,
    Range,
    as_bool,
    as_int,
    build,
    check_fields,
    choose,
    rules,
    variances,
)

ABOVE_ONE, ABOVE_HUGE = math.nextafter(1.0, 2.0), math.nextafter(1e9, math.inf)
SIZES = [1e-15, 1, np.float32(0.5), np.int8(3), np.array(4.0), Fraction(1, 4), 1e9]
NO_NUMBERS = [math.nan, -math.inf, "1", b"1", None, True, np.bool_(True), 1j, [1.0], np.array([1.0]), {}, 10**400, object()]
TOO_LARGE = [ABOVE_HUGE, 1e308, np.datetime64("2020-01-01")]
TOO_SMALL = [0.0, 9.99e-16, -1e-15, 5e-324, 9.9e-101, -9.9e-101]
SHARE = Range(0.0, 0.5, open_low=True, unit="s")
BELOW = Range(0.0, 1.0, open_high=True)
AGE = Range(-1.0, math.inf, open_low=True)
COUNT, SEED = Range(1, 3, whole=True), Range(0, math.inf, whole=True)
SIZE = "a positive number from 1e-15 to 1e+09"


@pytest.mark.parametrize(
    ("rule", "words", "accepted", "refused"),
    [
        (POSITIVE, SIZE, SIZES, [math.inf, *TOO_LARGE, *TOO_SMALL]),
        (POSITIVE_OR_INFINITE, f"{SIZE}, or infinite", [*SIZES, math.inf], [*TOO_LARGE, *TOO_SMALL]),
        (NON_NEGATIVE, "a number from 0 to 1e+09", [0.0, 0, 1e-100, *SIZES], [-1e-100, math.inf, *TOO_LARGE]),
        (FINITE, "a number from -1e+09 to 1e+09", [-1e9, -1e-100, 0, *SIZES], [math.inf, -ABOVE_HUGE, *TOO_LARGE]),
        (PROBABILITY, "a probability from 0 to 1", [0.0, 0, 1e-100, 0.5, 1, 1.0], [-1e-100, ABOVE_ONE, math.inf]),
        (SHARE, "a number above 0 and at most 0.5 s", [1e-100, 0.5], [0.0, 0.51]),
        (BELOW, "a number of at least 0 and below 1", [0.0, 0.99], [1.0, -0.1]),
        (AGE, "a number above -1", [-0.99, math.inf], [-1.0]),
        (COUNT, "a whole number from 1 to 3", [1, np.int64(3)], [0, 4, 1.0, 2.5]),
        (SEED, "a whole number of at least 0", [0, 2**62], [-1, 1.0, math.inf]),
    ],
    ids=str,
)
def test_a_range_accepts_its_numbers_and_says_in_words_what_they_are(rule, words, accepted, refused):
    assert (str(rule), rule.log) == (words, False)
    for value in accepted:
        kept = rule.check("it", value)
        assert kept == value
        assert type(kept) is (int if rule.whole else float)
    for value in (*refused, *(bad for bad in NO_NUMBERS if not (rule is SEED and type(bad) is int))):
        with pytest.raises(ValueError, match=f"^it must be {re.escape(words)}, got [^\n]+\\.$"):
            rule.check("it", value)


TINY = [(rule, size) for rule in (NON_NEGATIVE, FINITE, PROBABILITY, BELOW) for size in (5e-324, 9.9e-101)]


@pytest.mark.parametrize(("rule", "value"), [(FINITE, -9.9e-101), *TINY])
def test_nothing_but_zero_is_too_small_to_calculate_with(rule, value):
    with pytest.raises(ValueError, match=rf"^it must be 0 or at least 1e-100 in size, got {value}\.$"):
        rule.check("it", value)


@pytest.mark.parametrize(
    "given",
    [(1.0, 2.0), [1, 2], np.array([1.0, 2.0]), np.diag([1.0, 2.0]), [[1.0, 0.0], [0.0, 2.0]], ((1, 0), (0, 2))],
    ids=["tuple", "integers", "array", "matrix", "rows", "rows of integers"],
)
def test_variances_are_a_diagonal_of_floats(given):
    diagonal = variances(2).check("R", given)
    assert diagonal == (1.0, 2.0)
    assert [type(number) for number in diagonal] == [float, float]


NO_DIAGONALS = [
    3.0,
    None,
    "12",
    (1.0,),
    (1.0, 2.0, 3.0),
    (1.0, [0.0, 1.0]),
    [[1.0, 0.0], [0.0]],
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
    [[1.0, 0.5], [0.0, 1.0]],
    [[1.0, 0.0], [0.5, 1.0]],
    [[1.0, 1e-9], [1e-9, 1.0]],
    np.eye(3),
]


@pytest.mark.parametrize(
    ("rule", "given", "message"),
    [
        *((variances(2), given, "R must be 2 numbers or a diagonal 2 x 2 matrix of them, got ") for given in NO_DIAGONALS),
        (variances(2), (1.0, -0.1), "R[1] must be a number from 0 to 1e+09, got -0.1."),
        (variances(2), [[1.0, 0.0], [0.0, math.inf]], "R[1] must be a number from 0 to 1e+09, got inf."),
        (Numbers(FINITE, 3), (1.0, 2.0), "R must be 3 numbers, got (1.0, 2.0)."),
        (Numbers(FINITE, 2), (1.0, math.nan), "R[1] must be a number from -1e+09 to 1e+09, got nan."),
        (Numbers(), 1.0, "R must be a sequence of numbers, got 1.0."),
        (Numbers(), [[1.0]], "R[0] must be a number, got [1.0]."),
    ],
    ids=str,
)
def test_a_sequence_is_refused_by_the_place_that_is_wrong(rule, given, message):
    with pytest.raises(ValueError, match=f"^{re.escape(message)}"):
        rule.check("R", given)


def test_a_choice_is_what_the_name_stands_for():
    known = {"one": 1, "three": 3, 2.0: 2}
    assert [choose("number", name, known) for name in ("one", "three", 2.0)] == [1, 3, 2]
    for unknown, question in (("four", ""), ("thee", " Did you mean 'three'?"), (["one"], ""), (None, ""), (1, "")):
        message = f"number must be one of 'one', 'three', 2.0, got {unknown!r}.{question}"
        with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
            choose("number", unknown, known)


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """A part of `Whole`."""

    size: float = 1.0

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class Whole:
    """A field of each type that parameters have."""

    length: float
    width: Annotated[float, POSITIVE] = 1.0
    count: int = 1
    most: Annotated[int | None, COUNT] = None
    heavy: bool = False
    sides: tuple[float, ...] = ()
    part: Part = Part()
    name: str = ""

    def __post_init__(self) -> None:
        check_fields(self, "parameter " if self.name == "named" else None)


@pytest.mark.parametrize(
    ("name", "given", "kept"),
    [
        ("length", 2, 2.0),
        ("length", np.float32(0.5), 0.5),
        ("length", math.inf, math.inf),
        ("width", np.int64(3), 3.0),
        ("count", np.int8(7), 7),
        ("most", np.array(2), 2),
        ("most", None, None),
        ("heavy", np.bool_(True), True),
        ("sides", [1, np.float64(2.0)], (1.0, 2.0)),
        ("part", {"size": np.float32(2.0)}, Part(size=2.0)),
        ("part", {}, Part()),
    ],
)
def test_fields_get_the_types_that_they_are_declared_with(name, given, kept):
    value = getattr(Whole(**({"length": 1.0} | {name: given})), name)
    assert (value, type(value)) == (kept, type(kept))
    assert not isinstance(value, tuple) or [type(item) for item in value] == [float] * len(value)


@pytest.mark.parametrize(
    ("name", "given", "rule"),
    [
        *(("length", given, "must be a number, got ") for given in (True, "1", [1.0], np.array([1.0]), 10**400)),
        ("width", 0, r"must be a positive number from 1e-15 to 1e\+09, got 0"),
        *(("count", given, f"must be a whole number of at least 0, got {given}") for given in (1.0, True)),
        ("most", 4, "must be a whole number from 1 to 3, got 4"),
        *(("heavy", given, f"must be True or False, got {given!r}") for given in (1, math.nan, "yes")),
        ("sides", "12", "must be a sequence of numbers, got '12'"),
        ("part", 1, r"must be a Part or a mapping of its fields \(size\), got 1"),
        ("part", {"sizes": 1.0}, r": Part has no sizes; it has size. Did you mean 'size'\?"),
    ],
)
def test_other_types_are_refused_by_the_fields_name_and_its_prefix(name, given, rule):
    for prefix, more in ((r"Whole\.", {}), ("parameter ", {"name": "named"})):
        with pytest.raises(ValueError, match=rf"^{prefix}{name}:? ?{rule}[^\n]*$"):
            Whole(**({"length": 1.0} | {name: given} | more))


def test_parameters_are_made_of_a_mapping_and_arguments_are_checked_by_the_same_sentences():
    assert build(Whole, {"length": 2, "part": {"size": 3}}, "it") == Whole(length=2.0, part=Part(size=3.0))
    value = Whole(length=1.0)
    assert build(Whole, value, "it") is value
    with pytest.raises(ValueError, match=r"^it: Whole needs length\.$"):
        build(Whole, {"count": 2}, "it")
    assert (as_int("it", np.int64(2), 1, 3), as_bool("it", np.bool_(False))) == (2, False)
    with pytest.raises(ValueError, match=r"^it must be a whole number from 1 to 3, got 0\.$"):
        as_int("it", 0, 1, 3)


CLASSES = (
    Robot,
    ProcessNoise,
    OdometryNoise,
    FixNoise,
    FilterTuning,
    Kalman,
    Gated,
    Task,
    RoomRules,
    Lidar,
    MujocoBurger,
)
NEEDED = {
    Robot: {"max_linear": 0.2, "max_angular": 2.0},
    FixNoise: {"R": (0.1, 0.1)},
    FilterTuning: {"Q": (0.1,) * 5, "R": (0.1,) * 3},
    Gated: {"heading_gate": 6.0},
}
WITHOUT_RULE = {(FilterTuning, "kind"), (RoomRules, "kind"), (RoomRules, "start"), (RoomRules, "goal"), (Lidar, "dead")}


@pytest.mark.parametrize("cls", CLASSES)
def test_every_number_of_a_parameter_class_has_a_rule_and_is_refused_by_it(cls):
    declared = rules(cls)
    for item in fields(cls):
        without = (cls, item.name) in WITHOUT_RULE or item.type in ("bool", "ProcessNoise", "LidarMount")
        assert (item.name in declared) is not without, item.name
    for name, rule in declared.items():
        value, where, each = -ABOVE_HUGE, f"{cls.__name__}.{name}", rule
        if isinstance(rule, Numbers):
            last = (rule.size or 3) - 1
            value, where, each = (1.0,) * last + (value,), f"{where}[{last}]", rule.each
        with pytest.raises(ValueError, match=re.escape(f"{where} must be {each}, got -1")):
            cls(**NEEDED.get(cls, {}) | {name: value})


@pytest.mark.parametrize(
    ("cls", "given", "message"),
    [
        *((FilterTuning, {"kind": kind}, "kind must be a filter's own tuning, such as") for kind in (1.0, Kalman, None)),
        *(
            (FixNoise, {"R": R}, f"R must be two or three variances, those of x and y finite, got {R}")
            for R in ((0.1,), (0.1, 0.1, 0.1, 0.1), (0.1, math.inf))
        ),
        (FixNoise, {"R": (0.1, 0.1), "cross": (0.0, 0.0, 0.01)}, "cross must be covariances of errors with the variances"),
        (FixNoise, {"R": (0.1, 0.1, 0.1), "cross": (0.2, 0.0, 0.0)}, "cross must be covariances of errors"),
        (FixNoise, {"R": (0.1, 0.1, 0.1), "cross": (0.09, 0.09, -0.09)}, "cross must be covariances of errors"),
        (Task, {"arena": 1.0, "min_distance": 1.5}, "min_distance must be at most arena, got 1.5 > 1.0."),
        (Lidar, {"range_min": 2.0, "range_max": 1.0}, "range_min must be below range_max, got 2.0 >= 1.0."),
        (Lidar, {"dead": ((0.0,),)}, "dead[0] must be 2 numbers, got (0.0,)."),
        (Lidar, {"dead": ((0.0, 7.0),)}, "dead[0][1] must be a number from 0 to 6.28319 rad, got 7.0."),
        (Lidar, {"dead": ((0.0, 0.1),) * 5}, "dead must be at most 4 pairs of a direction and a width"),
        (Lidar, {"dead": 1.0}, "dead must be at most 4 pairs of a direction and a width, got 1.0."),
        (RoomRules, {"kind": 4.0}, "kind must be one of 0.0, 1.0, 2.0, 3.0, got 4.0."),
        (RoomRules, {"circles": (4.0, 2.0)}, "circles must be a least and a greatest value, got (4.0, 2.0)."),
        (RoomRules, {"circles": (1.5, 1.9)}, "circles must be whole numbers, got (1.5, 1.9)."),
        (RoomRules, {"boxes": (1.5, 1.9)}, "boxes must be whole numbers, got (1.5, 1.9)."),
        (RoomRules, {"start": (0.0, 0.0)}, "start must be a pose (x, y, theta), or NaN where it is drawn, got (0.0, 0.0)."),
        (RoomRules, {"goal": (0.0, 0.0, math.nan)}, "goal must be a pose (x, y, theta), or NaN where it is drawn"),
    ],
)
def test_what_does_not_go_together_is_refused(cls, given, message):
    with pytest.raises(ValueError, match=f"^{cls.__name__}.{re.escape(message)}"):
        cls(**NEEDED.get(cls, {}) | given)


@pytest.mark.parametrize("cls", [*CLASSES, Noise])
def test_parameters_are_frozen_and_take_keywords_only(cls):
    value = cls(**NEEDED.get(cls, {}))
    for item in fields(cls):
        with pytest.raises(AttributeError):
            setattr(value, item.name, getattr(value, item.name))
    with pytest.raises((AttributeError, TypeError)):
        value.unknown = 1.0
    with pytest.raises(TypeError):
        cls(0.1)
