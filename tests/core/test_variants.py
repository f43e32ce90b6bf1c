"""Variants: a mapping with a base is the base with some fields changed, wherever an option takes parameters."""

import math
from dataclasses import fields, is_dataclass, replace

import pytest

from turtlebot_gym import NOISES, ROBOTS, make_filter, make_noise, make_parameters, make_robot
from turtlebot_gym.files import load, write_parameters
from turtlebot_gym.localization.tuning import make_localizer
from turtlebot_gym.plants import make_plant
from turtlebot_gym.presets import FIXES, make_fix
from turtlebot_gym.rooms.lidar import LIDARS
from turtlebot_gym.rooms.rules import ROOMS
from turtlebot_gym.rooms.worlds import find_lidar, find_world
from turtlebot_gym.tasks import NAV, POSE, Task
from turtlebot_gym.variants import vary

GATED = make_filter("gated", NOISES["tutorial"])
CASES = {
    "robot": (make_robot, "burger", ROBOTS["burger"], {"max_linear": 0.1}),
    "noise": (make_noise, "rough", NOISES["rough"], {"process": replace(NOISES["rough"].process, alpha1=0.01)}),
    "fix": (make_fix, "late", FIXES["late"], {"period": 2.0}),
    "filter": (lambda given: make_filter(given, NOISES["tutorial"]), "gated", GATED, {"R": (0.1, 0.1, 0.2)}),
    "world": (find_world, "dense", ROOMS["dense"], {"courtesy": 0.2}),
    "lidar": (find_lidar, "a1", LIDARS["a1"], {"range_max": 5.0}),
    "localizer": (
        lambda given: make_localizer(given, LIDARS["a1"]),
        "robot",
        make_localizer("robot", LIDARS["a1"]),
        {"beams": 50},
    ),
    "plant": (make_plant, "mujoco", make_plant("mujoco"), {"caster_friction": 0.3}),
    "task": (lambda given: make_parameters(given).task, "pose", POSE, {"radius": 0.3}),
}


@pytest.mark.parametrize("name", CASES)
def test_a_variant_is_its_base_but_for_the_fields_that_are_given(name):
    make, base, made, changes = CASES[name]
    assert make({"base": base}) == make(base) == made
    assert make({"base": base, **changes}) == replace(made, **changes) != made
    with pytest.raises(ValueError, match=rf"{name}.* has no nosuch; it has .*{fields(made)[0].name}"):
        make({"base": base, "nosuch": 1.0})


@pytest.mark.parametrize("name", ["robot", "noise", "fix", "filter", "lidar", "localizer"])
def test_a_file_a_mapping_and_the_parameters_themselves_are_the_same(name, tmp_path):
    make, base, made, changes = CASES[name]
    own, path = replace(made, **changes), tmp_path / "own.yaml"
    write_parameters(own, path)
    assert make(own) == make(load(path)) == make(path) == make(str(path)) == own != make(base)
    assert make({"base": str(path)}) == own
    path.write_text("nosuch: 1.0")
    with pytest.raises(ValueError, match=rf"own\.yaml: {name}: \w+ has no nosuch"):
        make(path)


def test_inner_parameters_keep_the_fields_that_are_not_given():
    inner = {"odometry": {"dropout_probability": 0.3}}
    rough = NOISES["rough"]
    assert make_noise({"base": "rough", **inner}) == replace(rough, odometry=replace(rough.odometry, dropout_probability=0.3))
    kinder = make_filter({"base": "gated", "kind": {"gate": 9.0}}, NOISES["tutorial"])
    assert kinder == replace(GATED, kind=replace(GATED.kind, gate=9.0))
    other = make_filter({"base": "gated", "kind": {"name": "Kalman", "gate": 9.0}}, NOISES["tutorial"])
    assert type(other.kind).__name__ == "Kalman"
    with pytest.raises(ValueError, match=r"noise\.odometry: .* has no dropout; .*Did you mean 'dropout_probability'"):
        make_noise({"base": "rough", "odometry": {"dropout": 0.3}})


@pytest.mark.parametrize("made", [ROBOTS["burger"], NOISES["rough"], GATED, NAV, ROOMS["dense"], LIDARS["a1"]])
def test_every_field_can_be_given(made):
    for item in fields(made):
        value = getattr(made, item.name)
        assert vary(made, {item.name: value}, "it") == made
        if isinstance(value, float) and math.isfinite(value):
            with pytest.raises(ValueError, match=item.name):
                vary(made, {item.name: "many"}, "it")
        if is_dataclass(value):
            assert vary(made, {item.name: {}}, "it") == made


UNREAD = [
    ({"task": {"base": "nav", "margin": 0.1}}, "task.margin would change nothing: it is for arrival='belief'"),
    ({"task": {"base": "nav", "laps": 2}}, "task.laps would change nothing: this task has one goal"),
    ({"task": {"base": "room", "arena": 4.0}}, "task.arena would change nothing: a room determines start and goal"),
    ({"task": {"base": "nav", "on_belief": True}, "arrival": "belief"}, "task.on_belief is given twice"),
    ({"filter": {"base": "matched", "P0": [1.0] * 5}}, "P0 is read with from_origin"),
    ({"plant": {"base": "unicycle", "friction": 0.5}}, "plant.friction is for the plant 'mujoco', not for 'unicycle'"),
    ({"plant": {"base": "mujoco", "friction": 0.5, "nosuch": 1.0}}, "plant: MujocoBurger has no nosuch"),
]


@pytest.mark.parametrize(("options", "message"), UNREAD)
def test_a_field_that_changes_nothing_is_refused(options, message):
    with pytest.raises(ValueError, match=message):
        make_parameters(**options)


def test_a_tasks_own_limit_of_steps_is_that_of_the_environment():
    import gymnasium as gym

    task = {"base": "nav", "max_steps": 50.0}
    envs = gym.make_vec("turtlebot_gym/TurtleBotNav-v0", num_envs=2, task=task, max_episode_steps=50)
    assert envs.unwrapped.parameters.task == replace(NAV, max_steps=50.0)
    envs.close()
    with pytest.raises(ValueError, match="task ends episodes after 50 steps"):
        gym.make_vec("turtlebot_gym/TurtleBotNav-v0", num_envs=2, task=task)
    assert isinstance(make_parameters({"base": NAV, "radius": 0.5}).task, Task)
