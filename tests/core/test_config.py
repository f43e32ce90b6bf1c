"""Parameters: what each rule accepts and says, what a user may give in their place, and files of them."""

import math
import re
from contextlib import suppress
from dataclasses import asdict, dataclass, fields, is_dataclass, replace
from typing import Annotated

import numpy as np
import pytest
import yaml

from turtlebot_gym import NOISES, ROBOTS, Options, Robot, make_filter, make_noise, make_parameters, make_robot
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
    flattened,
    rules,
    variances,
)
from turtlebot_gym.files import load, load_object, replacing, write_parameters, write_text
from turtlebot_gym.localization.tuning import LOCALIZERS, make_localizer
from turtlebot_gym.parameters import FilterTuning, FixNoise
from turtlebot_gym.presets import FIXES
from turtlebot_gym.rooms.lidar import LIDARS, Lidar
from turtlebot_gym.rooms.rules import ROOMS, RoomRules
from turtlebot_gym.rooms.worlds import find_lidar, find_world
from turtlebot_gym.systems.imu import IMUS
from turtlebot_gym.tasks import TASKS, Task

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
    assert choose("number", "one", known) == Range().check("it", 1) == 1
    for name, question in (("four", ""), ("thee", " Did you mean 'three'?"), (["one"], ""), (None, "")):
        message = f"number must be one of 'one', 'three', got {name!r}.{question}"
        with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
            choose("number", name, known)
        with pytest.raises(ValueError, match=r"^number must be one of 'one', 'three'"):
            Names(("one", "three")).check("number", name)


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


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"length": -1.0}, "Whole.length must be a positive number from 1e-15 to 1e+09, got -1.0."),
        ({"count": 1.5}, "Whole.count must be a whole number of at least 0, got 1.5."),
        ({"flag": 1}, "Whole.flag must be True or False, got 1."),
        ({"limit": -1}, "Whole.limit must be a number from 0 to 1e+09, got -1."),
        ({"pair": (1.0,)}, "Whole.pair must be 2 numbers, got (1.0,)."),
        ({"any": [True]}, "Whole.any[0] must be a number, got True."),
        ({"part": 1}, "Whole.part must be a Part or a mapping of its fields (size), got 1."),
        ({"part": {"sizze": 1}}, "Whole.part: Part has no sizze; it has size. Did you mean 'size'?"),
        ({"breadth\n": 1.0}, "it: Whole has no breadth; it has length, count, flag, limit, pair, any, part."),
        ({"length": "x" * 999}, "Whole.length must be a positive number from 1e-15 to 1e+09, got '" + "x" * 199 + "."),
    ],
)
def test_a_wrong_field_is_named(wrong, message):
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        build(Whole, {"length": 1.0} | wrong, "it")
    with pytest.raises(ValueError, match=r"^it: Whole needs length\.$"):
        build(Whole, {}, "it")


KINDS = {
    "robot": (make_robot, ROBOTS, "burger"),
    "noise": (make_noise, NOISES, "rough"),
    "fix": (lambda fix: make_parameters(fix=fix).fix, FIXES, "late"),
    "imu": (lambda imu: make_parameters(imu=imu).imu, IMUS, "mpu9250"),
    "filter": (
        lambda filter: make_filter(filter, NOISES["rough"]),
        {"gated": make_filter("gated", NOISES["rough"])},
        "gated",
    ),
    "lidar": (find_lidar, LIDARS, "a1"),
    "localizer": (
        lambda tuning: make_localizer(tuning, LIDARS["a1"]),
        {name: make(LIDARS["a1"]) for name, make in LOCALIZERS.items()},
        "robot",
    ),
    "world": (find_world, ROOMS, "dense"),
    "task": (lambda task: make_parameters(task).task, TASKS, "nav"),
}
FILES = [name for name in KINDS if name not in ("world", "task")]


def paths_of(value, before=()):
    """Yield the path of each field of parameters, and of their parts, with its value."""
    for item in fields(value):
        yield (*before, item.name), getattr(value, item.name)
        if is_dataclass(getattr(value, item.name)):
            yield from paths_of(getattr(value, item.name), (*before, item.name))


def nested(path, value):
    """Return a mapping with a value at a path."""
    for key in path[::-1]:
        value = {key: value}
    return value


@pytest.mark.parametrize("name", KINDS)
def test_each_field_can_be_given_and_another_value_type_or_name_is_refused_in_one_line_that_names_it(name, tmp_path):
    make, presets, preset = KINDS[name]
    for path, value in paths_of(presets[preset]):
        if isinstance(value, str):
            continue
        given = (value, value) if not is_dataclass(value) else ({}, value)
        for change in given:
            assert make({"base": preset, **nested(path, change)}) == presets[preset]
        misspelt = (*path[:-1], f"{path[-1]}x")
        for wrong in (nested(path, ["no such value"]), nested(path, object()), nested(misspelt, value)):
            with pytest.raises(ValueError, match=rf"{path[-1]}|kind") as caught:
                make({"base": preset, **wrong})
            assert "\n" not in str(caught.value)
        if name in FILES and len(path) == 1:
            (tmp_path / "own.yaml").write_text(yaml.safe_dump(nested(misspelt, 1.0)))
            with pytest.raises(ValueError, match=rf"own\.yaml: .* has no {path[0]}|own\.yaml: .*{path[-1]}") as caught:
                make(tmp_path / "own.yaml")
            assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", KINDS)
def test_parameters_are_given_by_name_as_such_by_mapping_and_as_a_variant(name):
    make, presets, preset = KINDS[name]
    made = presets[preset]
    assert make(preset) == make(made) == make({"base": preset}) == make({"base": {"base": preset}}) == made
    assert name == "filter" or make(asdict(made)) == made
    numbers = [item.name for item in fields(made) if isinstance(getattr(made, item.name), float) and item.name != "kind"]
    for field in numbers[:1]:
        other = getattr(made, field) * 0.75 + 1e-3
        assert make({"base": preset, field: other}) == replace(made, **{field: other}) != made
    for unknown in ("nonsense", "", [], 3, 0.5, True, Ellipsis, {"nonsense": 1.0}):
        with pytest.raises(ValueError, match=name) as caught:
            make(unknown)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", FILES)
def test_parameters_are_read_as_they_were_written(name, tmp_path):
    make, presets, _ = KINDS[name]
    path = tmp_path / "lab" / "it.yaml"
    for preset in presets.values():
        write_parameters(preset, path, comment="Two lines\nof comment")
        assert path.read_text().startswith("# Two lines\n# of comment\n")
        assert make(path) == make(str(path)) == make({"base": str(path)}) == preset


def test_what_is_left_out_is_at_its_default_and_parts_keep_the_fields_that_are_not_given(tmp_path):
    path = tmp_path / "robot.yaml"
    write_text(path, "max_linear: 0.3\nmax_angular: 1\nmax_wheel: .inf\nreverse: false\n")
    assert make_robot(path) == Robot(max_linear=0.3, max_angular=1.0, max_wheel=math.inf, reverse=False)
    rough = NOISES["rough"]
    assert make_noise({"base": "rough", "odometry": {"dropout_probability": 0.3}}) == replace(
        rough, odometry=replace(rough.odometry, dropout_probability=0.3)
    )
    other = make_filter({"base": "gated", "kind": {"name": "Kalman", "gate": 9.0}}, rough)
    assert (type(other.kind).__name__, other.kind.gate) == ("Kalman", 9.0)
    assert [*flattened({"a": {"b": 1, "c": {}}, "d": 2})] == [("a.b", 1), ("a.c", {}), ("d", 2)]


NEEDED = {Robot: asdict(ROBOTS["burger"]), FixNoise: {"R": (0.1, 0.1)}, FilterTuning: {"Q": (0.1,) * 5, "R": (0.1,) * 3}}


@pytest.mark.parametrize(
    ("kind", "wrong", "message"),
    [
        *((FilterTuning, {"kind": wrong}, "kind must be a filter's own tuning, such as") for wrong in (1.0, FixNoise, None)),
        *((FixNoise, {"R": R}, "R must be two or three variances") for R in ((0.1,), (0.1,) * 4, (0.1, math.inf))),
        (FixNoise, {"cross": (0.0, 0.0, 0.01)}, "cross must be covariances of errors with the variances"),
        (FixNoise, {"R": (0.1,) * 3, "cross": (0.2, 0.0, 0.0)}, "cross must be covariances of errors"),
        (FixNoise, {"R": (0.1,) * 3, "cross": (0.09, 0.09, -0.09)}, "cross must be covariances of errors"),
        (Task, {"arena": 1.0, "min_distance": 1.5}, "min_distance must be at most Task.arena, 1 m, got 1.5."),
        (Lidar, {"range_min": 2.0, "range_max": 1.0}, "range_min must be below range_max, got 2.0 >= 1.0."),
        (Lidar, {"dead": ((0.0,),)}, "dead[0] must be 2 numbers, got (0.0,)."),
        (Lidar, {"dead": ((0.0, 7.0),)}, "dead[0][1] must be a number from 0 to 6.28319 rad, got 7.0."),
        (Lidar, {"dead": ((0.0, 0.1),) * 5}, "dead must be at most 4 pairs of a direction and a width"),
        (RoomRules, {"kind": 4.0}, "kind must be one of 0.0, 1.0, 2.0, 3.0, got 4.0."),
        (RoomRules, {"circles": (4.0, 2.0)}, "circles must be a least and a greatest value, got (4.0, 2.0)."),
        (RoomRules, {"boxes": (1.5, 1.9)}, "boxes must be whole numbers, got (1.5, 1.9)."),
        (RoomRules, {"start": (0.0, 0.0)}, "start must be a pose (x, y, theta), or NaN where it is drawn, got (0.0, 0.0)."),
    ],
    ids=str,
)
def test_what_does_not_go_together_is_refused(kind, wrong, message):
    with pytest.raises(ValueError, match=f"^{kind.__name__}.{re.escape(message)}"):
        kind(**NEEDED.get(kind, {}) | wrong)


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


def test_an_unknown_option_is_answered_with_the_nearest_one():
    for make in (make_parameters, lambda **options: Options.of(options)):
        with pytest.raises(TypeError, match=r"^There is no option 'nois'; options are task, robot, .* Did you mean 'noise'\?$"):
            make(nois="clean")


def test_the_import_registers_the_environments_and_brings_little_else(run):
    heavy = ("llvmlite", "scipy", "matplotlib", "filterpy", "pygame", "torch", "trimesh", "PIL")
    loaded, ids = run(f"""
import json, sys, turtlebot_gym, gymnasium
ids = sorted(id.partition("/TurtleBot")[2] for id in gymnasium.registry if id.startswith("turtlebot_gym/"))
print(json.dumps([[name for name in {heavy} if name in sys.modules], ids]))
""")
    assert (loaded, ids) == ([], ["Missions-v0", "Nav-v0", "Pose-v0", "Rooms-v0", "Square-v0"])
