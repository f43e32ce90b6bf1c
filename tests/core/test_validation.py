"""The checks themselves: what they let pass, and every word of what they answer."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from turtlebot_gym.validation import choose, require, variances


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


@pytest.mark.parametrize(
    ("rule", "holds", "fails"),
    [
        ("positive", [1e-300, 1, math.inf], [0.0, -1e-300, math.nan, "1", None]),
        ("non-negative", [0.0, 0, 1e300], [-1e-300, math.inf, math.nan, "1", None]),
        ("finite", [-1e300, 0, 1e300], [math.inf, -math.inf, math.nan, "1", None]),
        ("a probability", [0.0, 0, 0.5, 1, 1.0], [-1e-300, math.nextafter(1.0, 2.0), math.nan, "1", None]),
    ],
)
def test_the_rules(rule, holds, fails):
    for value in holds:
        require(SimpleNamespace(x=value), rule, "x")
    for value in fails:
        with pytest.raises(ValueError, match=f"SimpleNamespace.x must be {rule}"):
            require(SimpleNamespace(x=value), rule, "x")
