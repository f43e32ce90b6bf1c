"""Parameters: what each rule accepts, what a user may give in their place, and files of them."""

import math
import re
from collections.abc import Iterator
from contextlib import suppress
from copy import deepcopy
from dataclasses import asdict, fields, replace
from typing import Any

import numpy as np
import pytest
import yaml

from turtlebot_gym import NOISES, ROBOTS, OdometryNoise, Options, Robot, make_filter, make_noise, make_parameters, make_robot
from turtlebot_gym.config import (
    FINITE,
    NON_NEGATIVE,
    POSITIVE,
    POSITIVE_OR_INFINITE,
    PROBABILITY,
    Numbers,
    Range,
    build,
    choose,
    flattened,
)
from turtlebot_gym.files import load, load_object, replacing, write_parameters, write_text
from turtlebot_gym.localization.tuning import LOCALIZERS, make_localizer
from turtlebot_gym.parameters import FilterTuning, FixNoise, Noise
from turtlebot_gym.presets import FIXES
from turtlebot_gym.rooms.lidar import LIDARS, Lidar
from turtlebot_gym.rooms.rules import ROOMS, RoomRules
from turtlebot_gym.rooms.worlds import find_lidar, find_world
from turtlebot_gym.systems.sensors import IMUS
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


def test_numbers_become_a_tuple_of_floats():
    rule = Numbers(NON_NEGATIVE, 2)
    for value in ((1.0, 2.0), [1, 2], np.array([1.0, 2.0])):
        assert repr(rule.check("R", value)) == "(1.0, 2.0)"
    for value in (3.0, None, "12", (1.0,), (1.0, -1.0), [[1.0], [1.0]], np.eye(2)):
        with pytest.raises(ValueError, match=r"^R(\[.\])? must be (2 numbers|a number from 0)"):
            rule.check("R", value)


def test_an_unknown_name_is_answered_with_the_known_ones_and_the_nearest():
    assert choose("number", "one", {"one": 1, "three": 3}) == 1
    for name, question in (("four", ""), ("thee", " Did you mean 'three'?"), (["one"], ""), (None, "")):
        message = f"number must be one of 'one', 'three', got {name!r}.{question}"
        with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
            choose("number", name, {"one": 1, "three": 3})
    for make in (make_parameters, lambda **options: Options.of(options)):
        with pytest.raises(TypeError, match=r"^There is no option 'nois'; options are task, robot, .* Did you mean 'noise'\?$"):
            make(nois="clean")


def test_fields_get_the_types_that_they_are_declared_with():
    made = Task(laps=np.int64(3), random=np.bool_(False), radius=np.float32(0.5))
    assert [type(value) for value in (made.laps, made.random, made.radius)] == [int, bool, float]
    assert repr(Noise(odometry={"R": np.zeros(3), "spike": 1})) == repr(Noise(odometry=OdometryNoise(spike=1.0)))
    assert build(Task, made, "it") is made
    with pytest.raises(ValueError, match=r"^it: FixNoise needs R\.$"):
        build(FixNoise, {}, "it")
    with pytest.raises(ValueError, match=r"^Task\.radius must be .*, got 'x{199}\.$"):  # shortened
        Task(radius="x" * 999)


NEEDED = {Robot: asdict(ROBOTS["burger"]), FixNoise: {"R": (0.1, 0.1)}, FilterTuning: {"Q": (0.1,) * 5, "R": (0.1,) * 3}}


@pytest.mark.parametrize(
    ("kind", "field", "wrong"),
    [
        *((FilterTuning, "kind", wrong) for wrong in (1.0, FixNoise, None)),
        *((FixNoise, "R", R) for R in ((0.1,), (0.1,) * 4, (0.1, math.inf))),
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


# Each kind of option: by name, as such, by mapping, by file, and as a variant.

ROUGH, A1 = NOISES["rough"], LIDARS["a1"]
KINDS: dict[str, tuple[Any, dict[str, Any], str]] = {
    "robot": (make_robot, ROBOTS, "burger"),
    "noise": (make_noise, NOISES, "recorded"),
    "fix": (lambda fix: make_parameters(fix=fix).fix, FIXES, "late"),
    "imu": (lambda imu: make_parameters(imu=imu).imu, IMUS, "mpu9250"),
    "filter": (lambda filter: make_filter(filter, ROUGH), {"gated": make_filter("gated", ROUGH)}, "gated"),
    "lidar": (find_lidar, LIDARS, "a1"),
    "localizer": (lambda given: make_localizer(given, A1), {name: make(A1) for name, make in LOCALIZERS.items()}, "robot"),
    "world": (find_world, ROOMS, "dense"),
    "task": (lambda task: make_parameters(task).task, TASKS, "nav"),
}
FILES = [name for name in KINDS if name not in ("world", "task")]  # a world's file is a map
VALUES = {
    bool: [3, "yes"],
    int: [math.nan, "1", True],
    float: [math.nan, "1.0", True],
    str: [3],
    list: ["x", [["x"]]],
    dict: [3],
}
"""Wrong values and types for a field, by the type that YAML has for it."""


def content_of(parameters: Any) -> dict[str, Any]:
    """Return parameters as a file has them."""
    content = yaml.safe_load(yaml.safe_dump(asdict(parameters)))
    return content | ({"kind": {"name": "Gated", **content["kind"]}} if hasattr(parameters, "from_origin") else {})


def wrong_ones(content: dict[str, Any], whole: dict[str, Any] | None = None) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the name of each field, and the whole with a wrong value, type or name of it."""
    whole = content if whole is None else whole
    for name, value in [*content.items()]:
        for wrong in VALUES[type(value)]:
            content[name] = wrong
            yield ("kind" if name == "name" else name), deepcopy(whole)
        content.pop(name)
        content[f"{name}x"] = value
        yield ("kind" if name == "name" else f"{name}x"), deepcopy(whole)
        content.pop(f"{name}x")
        content[name] = value
        if isinstance(value, dict):
            yield from wrong_ones(value, whole)


@pytest.mark.parametrize("name", KINDS)
def test_a_wrong_value_type_or_name_of_each_field_is_refused_in_one_line_that_names_it(name, tmp_path):
    make, presets, preset = KINDS[name]
    path, content = tmp_path / "own.yaml", content_of(presets[preset])
    assert repr(make(content)) == repr(presets[preset])  # a drawn pose is NaN
    for field, wrong in [*wrong_ones(content)]:
        path.write_text(yaml.safe_dump(wrong))
        with pytest.raises(ValueError, match=rf"\b{field}\b") as caught:
            make(path if name in FILES else wrong)
        assert "\n" not in str(caught.value)
        assert name not in FILES or str(caught.value).startswith(f"{path}: ")
    assert len([*wrong_ones(content)]) >= 2 * len(fields(presets[preset]))


@pytest.mark.parametrize("name", KINDS)
def test_parameters_are_given_by_name_as_such_by_mapping_and_as_a_variant(name):
    make, presets, preset = KINDS[name]
    made = presets[preset]
    assert make(preset) == make(made) == make({"base": preset}) == make({"base": {"base": preset}}) == made
    for field, value in flattened(asdict(made)):
        change: Any = value
        for key in field.split(".")[::-1]:
            change = {key: change}
        assert repr(make({"base": preset} | change)) == repr(made)
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
