"""Parameters: what each rule accepts and says, what a user may give in their place, and files of them."""

import math
import re
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from typing import Annotated

import numpy as np
import pytest

from turtlebot_gym import NOISES, ROBOTS, OdometryNoise, Robot, make_filter, make_noise
from turtlebot_gym.config import (
    FINITE,
    NON_NEGATIVE,
    POSITIVE,
    POSITIVE_OR_INFINITE,
    PROBABILITY,
    Names,
    Numbers,
    Range,
    build,
    check_fields,
    choose,
    rules,
    variances,
)
from turtlebot_gym.files import load, load_object, replacing, write_text
from turtlebot_gym.parameters import FilterTuning, FixNoise
from turtlebot_gym.rooms.lidar import Lidar
from turtlebot_gym.rooms.rules import RoomRules
from turtlebot_gym.tasks import Task

NO_NUMBERS = [math.nan, -math.inf, "1", None, True, np.bool_(True), 1j, [1.0], np.array([1.0]), {}]
SIZES = [1e-15, 1, np.float32(0.5), np.int8(3), np.array(4.0), 1e9]


@pytest.mark.parametrize(
    ("rule", "words", "accepted", "refused"),
    [
        (POSITIVE, "a positive number from 1e-15 to 1e+09", SIZES, [0.0, 9e-16, -1.0, math.inf, 1.1e9]),
        (POSITIVE_OR_INFINITE, "a positive number from 1e-15 to 1e+09, or infinite", [*SIZES, math.inf], [0.0, 1.1e9]),
        (NON_NEGATIVE, "a number from 0 to 1e+09", [0, 0.0, *SIZES], [-1e-100, math.inf]),
        (FINITE, "a number from -1e+09 to 1e+09", [-1e9, 0, *SIZES], [math.inf, -1.1e9]),
        (PROBABILITY, "a probability from 0 to 1", [0, 1.0], [1.1, -1e-100]),
        (Range(0.0, 0.5, open_low=True, unit="s"), "a number above 0 and at most 0.5 s", [1e-100, 0.5], [0.0, 0.51]),
        (Range(0.0, 1.0, open_high=True), "a number of at least 0 and below 1", [0.0, 0.99], [1.0, -0.1]),
        (Range(-1.0, math.inf, open_low=True).of("m"), "a number above -1 m", [-0.99, math.inf], [-1.0]),
        (Range(1, 3, whole=True), "a whole number from 1 to 3", [1, np.int64(3)], [0, 4, 1.0]),
    ],
    ids=str,
)
def test_a_range_accepts_its_numbers_and_says_what_they_are(rule, words, accepted, refused):
    assert [rule.check("it", value) for value in accepted] == accepted
    assert [type(rule.check("it", value)) for value in accepted] == [int if rule.whole else float] * len(accepted)
    for value in (*refused, *NO_NUMBERS):
        with pytest.raises(ValueError, match=f"^it must be {re.escape(words)}, got [^\n]+\\.$"):
            rule.check("it", value)


@pytest.mark.parametrize("value", [(1.0, 2.0), [1, 2], np.array([1.0, 2.0]), np.diag([1.0, 2.0]), [[1.0, 0.0], [0.0, 2.0]]])
def test_variances_are_a_diagonal_of_floats(value):
    assert variances(2).check("R", value) == (1.0, 2.0)
    assert list(map(type, variances(2).check("R", value))) == [float, float]


@pytest.mark.parametrize("value", [3.0, None, "12", (1.0,), (1.0, -1.0), [[1.0, 0.5], [0.0, 1.0]], [[1.0], [1.0]], np.eye(3)])
def test_other_variances_are_refused(value):
    with pytest.raises(ValueError, match=r"^R(\[.\])? must be (2 numbers or a diagonal 2 x 2|a number from|a number)"):
        variances(2).check("R", value)


def test_a_choice_is_what_the_name_stands_for():
    known = {"one": 1, "three": 3}
    assert choose("number", "one", known) == 1
    for name, question in (("four", ""), ("thee", " Did you mean 'three'?"), (["one"], ""), (None, "")):
        message = f"number must be one of 'one', 'three', got {name!r}.{question}"
        with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
            Names(tuple(known)).check("number", name)


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """A part of `Whole`."""

    size: float = 1.0

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class Whole:
    """A field of each type that parameters have."""

    length: Annotated[float, POSITIVE]
    count: int = 1
    flag: bool = False
    limit: Annotated[float | None, NON_NEGATIVE] = None
    pair: Annotated[tuple[float, ...], Numbers(FINITE, 2)] = (0.0, 0.0)
    any: tuple[float, ...] = (math.nan,)
    part: Part = Part()

    def __post_init__(self) -> None:
        check_fields(self)


def test_fields_get_the_types_that_they_are_declared_with():
    made = Whole(length=np.float32(2), count=np.int64(3), flag=np.bool_(True), pair=np.zeros(2), any=[1], part={"size": 3})
    assert made == Whole(length=2.0, count=3, flag=True, pair=(0.0, 0.0), any=(1.0,), part=Part(size=3.0))
    assert [type(value) for value in (made.length, made.count, made.flag, made.any[0])] == [float, int, bool, float]
    assert (build(Whole, made, "it") is made, made.limit, rules(Whole)["length"]) == (True, None, POSITIVE)


def test_a_message_is_one_short_line_that_asks_whether_a_similar_name_was_meant():
    for wrong, message in (
        ({"any": [True]}, "Whole.any[0] must be a number, got True."),
        ({"part": {"sizze": 1}}, "Whole.part: Part has no sizze; it has size. Did you mean 'size'?"),
        ({"length": "x" * 999}, "Whole.length must be a positive number from 1e-15 to 1e+09, got '" + "x" * 199 + "."),
    ):
        with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
            build(Whole, {"length": 1.0} | wrong, "it")
    with pytest.raises(ValueError, match=r"^it: Whole needs length\.$"):
        build(Whole, {}, "it")


NEEDED = {Robot: asdict(ROBOTS["burger"]), FixNoise: {"R": (0.1, 0.1)}, FilterTuning: {"Q": (0.1,) * 5, "R": (0.1,) * 3}}


@pytest.mark.parametrize(
    ("kind", "field", "wrong"),
    [
        *((FilterTuning, "kind", wrong) for wrong in (1.0, FixNoise, None)),
        *((FixNoise, "R", R) for R in ((0.1,), (0.1,) * 4, (0.1, math.inf))),
        (FixNoise, "cross", (0.0, 0.0, 0.01)),
        (FixNoise, "cross", (0.2, 0.0, 0.0)),
        (OdometryNoise, "leap_probability", 0.1),
        (Task, "min_distance", 2.5),
        (Lidar, "range_min", 99.0),
        *((Lidar, "dead", wrong) for wrong in (((0.0,),), ((0.0, 7.0),), ((0.0, 0.1),) * 5)),
        (RoomRules, "kind", 4.0),
        *((RoomRules, "circles", wrong) for wrong in ((4.0, 2.0), (1.5, 1.9))),
        (RoomRules, "start", (0.0, 0.0)),
    ],
    ids=str,
)
def test_what_does_not_go_together_is_refused(kind, field, wrong):
    with pytest.raises(ValueError, match=rf"^{kind.__name__}\.{field}\b[^\n]* must be [^\n]*$"):
        kind(**NEEDED.get(kind, {}) | {field: wrong})


def test_parts_keep_the_fields_that_are_not_given_and_a_name_chooses_another_class():
    rough = NOISES["rough"]
    made = make_noise({"base": "rough", "odometry": {"dropout_probability": 0.3}})
    assert made == replace(rough, odometry=replace(rough.odometry, dropout_probability=0.3))
    other = make_filter({"base": "gated", "kind": {"name": "Kalman", "gate": 9.0}}, rough)
    assert (type(other.kind).__name__, other.kind.gate) == ("Kalman", 9.0)


def test_numbers_are_read_as_one_writes_them(tmp_path):
    (tmp_path / "a.yaml").write_text("[1e-3, 1e6, -2.5e3, .5E1, 1.5, 3, 0x10, .inf, e3, '1e3']")
    content = load(tmp_path / "a.yaml")
    assert content == [0.001, 1_000_000, -2500, 5, 1.5, 3, 16, math.inf, "e3", "1e3"]
    assert [type(number) for number in content[:5]] == [float, int, int, int, float]
    (tmp_path / "a.json").write_text('{"a": [1e6, null, "x"]}')
    assert load(tmp_path / "a.json") == {"a": [1e6, None, "x"]}
    with pytest.raises(FileNotFoundError):
        load(tmp_path / "none.json")


@pytest.mark.parametrize("name", ["a.json", "a.yaml"])
@pytest.mark.parametrize("content", [b"{", b"\xff", b"!!python/object/apply:os.system [ls]", b"!!int ''", b"[" * 10**5])
def test_what_is_no_json_and_no_yaml_is_refused_in_one_line_that_names_the_file(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ValueError, match=rf"^{re.escape(str(tmp_path / name))}: it is not (JSON|YAML): ") as caught:
        load(tmp_path / name)
    assert "\n" not in str(caught.value)


def test_a_file_is_replaced_as_a_whole_or_not_at_all(tmp_path):
    path = tmp_path / "new" / "it.json"
    write_text(path, "[1]")
    with suppress(KeyboardInterrupt), replacing(path) as beside:
        beside.write_text("[2")
        raise KeyboardInterrupt
    assert load(path) == [1]
    assert list(path.parent.iterdir()) == [path]
    write_text("/dev/null", "away")


def test_objects_are_found_by_module_and_name_in_the_working_folder_too(tmp_path, monkeypatch):
    (tmp_path / "mine_of_config.py").write_text("VALUE = 3\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.path", [path for path in __import__("sys").path if path])
    assert load_object("mine_of_config:VALUE") == 3
    for wrong in ("mine_of_config", "mine_of_config:NONE", "no_such_module:X", "./mine_of_config:VALUE", "mine.py:VALUE"):
        with pytest.raises(ValueError, match=r"must be 'module:name'|cannot be loaded from") as caught:
            load_object(wrong)
        assert wrong in str(caught.value)


def test_the_import_registers_the_environments_and_brings_little_else(run):
    heavy = ("llvmlite", "scipy", "matplotlib", "filterpy", "pygame", "torch", "trimesh", "PIL")
    loaded, ids = run(f"""
import json, sys, turtlebot_gym, gymnasium
ids = sorted(id.partition("/TurtleBot")[2] for id in gymnasium.registry if id.startswith("turtlebot_gym/"))
print(json.dumps([[name for name in {heavy} if name in sys.modules], ids]))
""")
    assert (loaded, ids) == ([], ["Missions-v0", "Nav-v0", "Pose-v0", "Rooms-v0", "Square-v0"])
