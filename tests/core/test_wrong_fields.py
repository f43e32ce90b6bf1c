"""What a user may give in place of parameters, for each kind of option; a wrong field is refused in one line that names it."""

import math
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import asdict, fields, replace
from typing import Any

import pytest
import yaml

from turtlebot_gym import NOISES, ROBOTS, Options, make_filter, make_noise, make_parameters, make_robot
from turtlebot_gym.config import flattened
from turtlebot_gym.files import write_parameters
from turtlebot_gym.localization.tuning import LOCALIZERS, make_localizer
from turtlebot_gym.presets import FIXES
from turtlebot_gym.rooms.lidar import LIDARS
from turtlebot_gym.rooms.rules import ROOMS
from turtlebot_gym.rooms.worlds import find_lidar, find_world
from turtlebot_gym.systems.imu import IMUS
from turtlebot_gym.tasks import TASKS

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


def test_an_unknown_option_is_answered_with_the_nearest_one():
    for make in (make_parameters, lambda **options: Options.of(options)):
        with pytest.raises(TypeError, match=r"^There is no option 'nois'; options are task, robot, .* Did you mean 'noise'\?$"):
            make(nois="clean")
