"""The checks themselves: what they let pass, and every word of what they answer."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest

from turtlebot_gym.validation import check_fields, choose, made, named, ranged, require, typed, variances


@pytest.mark.parametrize(
    "given",
    [
        (1.0, 2.0),
        [1, 2],
        np.array([1.0, 2.0]),
        np.diag([1.0, 2.0]),
        [[1.0, 0.0], [0.0, 2.0]],
        ((1, 0), (0, 2)),
    ],
    ids=["tuple", "integers", "array", "matrix", "rows", "rows of integers"],
)
def test_variances_are_a_diagonal_of_floats(given):
    got = variances("R", given, 2)
    assert got == (1.0, 2.0)
    assert [type(number) for number in got] == [float, float]


@pytest.mark.parametrize(
    ("given", "rule"),
    [
        ((1.0, [0.0, 1.0]), "be a 2 x 2 matrix, got (1.0, [0.0, 1.0])."),
        (3.0, "hold 2 variances or be a 2 x 2 matrix, got 3.0."),
        (None, "hold 2 variances or be a 2 x 2 matrix, got None."),
        ((1.0,), "hold 2 variances or be a 2 x 2 matrix, got (1.0,)."),
        ((1.0, 2.0, 3.0), "hold 2 variances or be a 2 x 2 matrix, got (1.0, 2.0, 3.0)."),
        ([[1.0, 0.0], [0.0]], "be a 2 x 2 matrix, got [[1.0, 0.0], [0.0]]."),
        ([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], "be a 2 x 2 matrix, got [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]."),
        ([[1.0, 0.5], [0.0, 1.0]], "be symmetric, got [[1.0, 0.5], [0.0, 1.0]]."),
        ([[1.0, 0.0], [0.5, 1.0]], "be symmetric, got [[1.0, 0.0], [0.5, 1.0]]."),
        (
            [[1.0, 0.5], [0.5, 1.0]],
            "be diagonal (the components' noises are independent), got [[1.0, 0.5], [0.5, 1.0]].",
        ),
        ((1.0, -0.1), "hold finite variances >= 0, got (1.0, -0.1)."),
        ((math.inf, 1.0), "hold finite variances >= 0, got (inf, 1.0)."),
        ((1.0, math.nan), "hold finite variances >= 0, got (1.0, nan)."),
        ([[1.0, 0.0], [0.0, -1.0]], "hold finite variances >= 0, got [[1.0, 0.0], [0.0, -1.0]]."),
    ],
)
def test_other_variances_are_refused_with_the_rule(given, rule):
    with pytest.raises(ValueError, match=r"^R must ") as caught:
        variances("R", given, 2)
    assert str(caught.value) == f"R must {rule}"


@pytest.mark.parametrize(("i", "j"), [(0, 1), (0, 2), (1, 2), (1, 0), (2, 0), (2, 1)])
def test_any_entry_beside_the_diagonal_is_seen(i, j):
    matrix = np.eye(3)
    matrix[i, j] = 1e-9
    with pytest.raises(ValueError, match="be symmetric"):
        variances("R", matrix, 3)
    matrix[j, i] = 1e-9
    with pytest.raises(ValueError, match="be diagonal"):
        variances("R", matrix, 3)


def test_a_choice_is_what_the_name_stands_for():
    known = {"one": 1, "two": 2}
    assert [choose("number", name, known) for name in ("one", "two")] == [1, 2]
    with pytest.raises(ValueError, match=r"^number must be one of 'one', 'two', got 'three'\.$"):
        choose("number", "three", known)


def test_every_field_that_is_named_is_checked():
    owner = SimpleNamespace(first=1.0, second=-1.0, third=(1.0, 2.0, -3.0))
    require(owner, "positive", "first")
    require(owner, "finite", "first", "second", "third")
    for names in (("second",), ("first", "second"), ("second", "first")):
        with pytest.raises(ValueError, match=r"^SimpleNamespace\.second must be positive, got -1\.0\.$"):
            require(owner, "positive", *names)
    with pytest.raises(ValueError, match=r"^SimpleNamespace\.third must be non-negative, got \(1\.0, 2\.0, -3\.0\)\.$"):
        require(owner, "non-negative", "first", "third")


SIZES = [1e-15, 1, np.nextafter(1e9, 0.0).item(), 1e9]
NONE = [math.nan, "1", None, True, np.bool_(True)]


@pytest.mark.parametrize(
    ("rule", "holds", "fails"),
    [
        ("positive", SIZES, [0.0, -1e-15, math.inf, *NONE]),
        ("positive or infinite", [*SIZES, math.inf], [0.0, -1e-15, -math.inf, *NONE]),
        ("non-negative", [0.0, 0, *SIZES], [-1e-15, math.inf, *NONE]),
        ("finite", [-1e9, -1e-15, 0, *SIZES], [math.inf, -math.inf, *NONE]),
        ("a probability", [0.0, 0, 1e-15, 0.5, 1, 1.0], [-1e-15, math.nextafter(1.0, 2.0), *NONE]),
    ],
)
def test_the_rules(rule, holds, fails):
    for value in holds:
        require(SimpleNamespace(x=value), rule, "x")
    for value in fails:
        with pytest.raises(ValueError, match=f"SimpleNamespace.x must be {rule}, got"):
            require(SimpleNamespace(x=value), rule, "x")


@pytest.mark.parametrize(
    ("rule", "small", "told"),
    [
        ("positive", 9e-16, "from 1e-15"),
        ("positive or infinite", 9e-16, "from 1e-15"),
        ("non-negative", 9e-101, "0 or from 1e-100"),
        ("finite", -9e-101, "0 or from 1e-100"),
    ],
)
def test_what_is_finite_has_a_size_with_which_one_can_calculate(rule, small, told):
    for value in (small, 1.1e9, (1.0, 1.1e9), 1e308, 5e-324):
        with pytest.raises(ValueError, match=rf"SimpleNamespace.x must be {told} to 1e\+09 in size, got"):
            require(SimpleNamespace(x=value), rule, "x")


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """A part of `Whole`."""

    size: float = 1.0

    def __post_init__(self) -> None:
        typed(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class Whole:
    """A field of each type that parameters have."""

    length: float
    count: int = 1
    heavy: bool = False
    sides: tuple[float, ...] = ()
    part: Part = Part()

    def __post_init__(self) -> None:
        typed(self)


@pytest.mark.parametrize(
    ("name", "given", "kept"),
    [
        ("length", 2, 2.0),
        ("length", np.float32(0.5), 0.5),
        ("length", np.int64(3), 3.0),
        ("length", np.array(4.0), 4.0),
        ("length", Fraction(1, 4), 0.25),
        ("count", np.int8(7), 7),
        ("heavy", np.bool_(True), True),
        ("sides", [1, np.float64(2.0)], (1.0, 2.0)),
        ("sides", np.array([3, 4]), (3.0, 4.0)),
        ("part", {"size": np.float32(2.0)}, Part(size=2.0)),
        ("part", {}, Part()),
    ],
)
def test_fields_get_the_types_that_they_are_declared_with(name, given, kept):
    found = getattr(Whole(**({"length": 1.0} | {name: given})), name)
    assert found == kept
    assert type(found) is type(kept)
    assert not isinstance(found, tuple) or [type(item) for item in found] == [float] * len(found)


@pytest.mark.parametrize(
    ("name", "given", "rule"),
    [
        ("length", True, "must be a number, got True"),
        ("length", "1", "must be a number, got '1'"),
        ("length", 1j, "must be a number, got 1j"),
        ("length", [1.0], r"must be a number, got \[1.0\]"),
        ("length", np.array([1.0]), r"must be a number, got array\(\[1.\]\)"),
        ("length", 10**400, r"must be at most 1e\+09 in size, got a whole number beyond all floats"),
        ("count", 1.0, "must be a whole number of at least 0, got 1.0"),
        ("count", -1, "must be a whole number of at least 0, got -1"),
        ("count", True, "must be a whole number of at least 0, got True"),
        ("heavy", 1, "must be True or False, got 1"),
        ("heavy", math.nan, "must be True or False, got nan"),
        ("heavy", "yes", "must be True or False, got 'yes'"),
        ("sides", 1.0, "must be a sequence of numbers, got 1.0"),
        ("sides", "12", "must be a sequence of numbers, got '12'"),
        ("sides", {1.0}, r"must be a sequence of numbers, got \{1.0\}"),
        ("sides", [[1.0]], r"\[0\] must be a number, got \[1.0\]"),
        ("part", 1, r"must be a Part or a mapping of its fields \(size\), got 1"),
        ("part", {"weight": 1.0}, ": Part has no weight; it has size"),
    ],
)
def test_other_types_are_refused_by_the_fields_name(name, given, rule):
    with pytest.raises(ValueError, match=rf"^Whole\.{name}:? ?{rule}") as caught:
        Whole(**({"length": 1.0} | {name: given}))
    assert "\n" not in str(caught.value)


def test_parameters_are_made_of_a_mapping():
    assert made(Whole, {"length": 2, "part": {"size": 3}}, "it") == Whole(length=2.0, part=Part(size=3.0))
    whole_ = Whole(length=1.0)
    assert made(Whole, whole_, "it") is whole_
    with pytest.raises(ValueError, match=r"^it: Whole needs length\.$"):
        made(Whole, {"count": 2}, "it")


@dataclass
class Fields:
    period: float = ranged(0.1, 0.0, 60.0, " s", above=True)
    share: float = ranged(0.0, 0.0, 1.0, below=True)
    laps: int = ranged(1, 1, 2**40)
    storage: str = named("a", "a", "b", or_else=lambda name: name.endswith(".yaml"), other=", or a FILE.yaml")
    free: object = None


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("period", 0.0, "period must be in (0, 60] s, got 0.0."),
        ("period", 60.1, "period must be in (0, 60] s, got 60.1."),
        ("period", math.nan, "period must be in (0, 60] s, got nan."),
        ("share", -0.1, "share must be in [0, 1), got -0.1."),
        ("share", 1.0, "share must be in [0, 1), got 1.0."),
        ("laps", 0, "laps must be in [1, 1099511627776], got 0."),
        ("storage", "c", "storage must be one of a, b, or a FILE.yaml, got 'c'."),
    ],
)
def test_a_field_that_breaks_its_rule_is_named_with_it(name, value, said):
    check_fields(Fields())
    check_fields(Fields(period=60.0, share=0.0, laps=2**40, storage="d.yaml", free=-1.0))
    with pytest.raises(ValueError) as refused:  # noqa: PT011  # the message is compared below
        check_fields(Fields(**{name: value}))
    assert str(refused.value) == said
