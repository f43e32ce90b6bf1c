"""Whatever a YAML file or a table holds, it is read, or refused with one line."""

import json
import math
from dataclasses import asdict

import gymnasium as gym
import numpy as np
import pytest
import yaml
from fuzzing import FOLDER, SCALARS, VALUES, answered, fuzzed, mutated, replaced
from hypothesis import strategies as st

from turtlebot_gym import FixNoise, Noise, Robot, read_parameters
from turtlebot_gym.files import load
from turtlebot_gym.presets import FIXES, NOISES
from turtlebot_gym.robots import ROBOTS
from turtlebot_gym.rooms.worlds import find_world

pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")

from turtlebot_gym_agents.cluster.grid import read_grid
from turtlebot_gym_agents.policies import make_policy
from turtlebot_gym_agents.training import hyperparameters
from turtlebot_gym_agents.training.model import arguments

EXAMPLES = {Noise: asdict(NOISES["rough"]), Robot: asdict(ROBOTS["burger"]), FixNoise: asdict(FIXES["late"])}


def plain(value):
    if isinstance(value, dict):
        return {name: plain(item) for name, item in value.items()}
    return [plain(item) for item in value] if isinstance(value, (list, tuple)) else value


def written(name, content):
    path = FOLDER / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8", "surrogatepass"))
    return path


def dumped(value):
    return yaml.safe_dump(value, sort_keys=False)


TEXTS = st.one_of(
    st.text(max_size=60),
    st.lists(
        st.sampled_from(
            [
                "a",
                ": ",
                "- ",
                "{",
                "}",
                "[",
                "]",
                "\n",
                "  ",
                "&x",
                "*x",
                "!!int ",
                "!!float ",
                "!!timestamp ",
                "!!bool ",
                "1e-3",
                "~",
                "|",
                ">",
                "'",
                '"',
                "? ",
                "<<",
                "2001-99-99",
                "0x",
                "\t",
                "%",
            ]
        ),
        max_size=20,
    ).map("".join),
    VALUES.map(dumped),
)


@fuzzed(150, 2500, text=TEXTS)
def test_any_text_is_yaml_or_one_line_says_why_not(text):
    answered("YAML", lambda: (load(written("a.yaml", text)), True))


@fuzzed(250, 3200, kind=st.sampled_from(list(EXAMPLES)), damaged=st.booleans(), data=st.data())
def test_files_of_parameters(kind, damaged, data):
    example = plain(EXAMPLES[kind])
    assert read_parameters(kind, written("b.yaml", dumped(example)))
    said = data.draw(mutated(dumped(example).encode())) if damaged else dumped(replaced(data.draw, example, VALUES))
    answered("files of parameters", lambda: read_parameters(kind, written("c.yaml", said)))


SHIPPED = {algo: hyperparameters.load(algo, "default") for algo in ("ppo", "sac", "td3")}
NAMES = sorted(
    {name for hyper in SHIPPED.values() for name in hyper} | {"gamme", "device", "seed", "env", "n_step", "clip_range"}
)


@fuzzed(200, 2600, algo=st.sampled_from(sorted(SHIPPED)), name=st.sampled_from(NAMES), data=st.data())
def test_hyperparameters(algo, name, data):
    said = dict(SHIPPED[algo])
    if data.draw(st.booleans()):
        said[name] = data.draw(st.one_of(SCALARS, VALUES))
    else:
        said = replaced(data.draw, said, VALUES)

    def load():
        return arguments(algo, hyperparameters.load(algo, "default", written("e.yaml", dumped({"default": said}))))

    answered("hyper-parameters", load)


STUDY = {
    "episodes": 20,
    "seed": 5,
    "compare_with": "bearing",
    "policies": ["bearing", "proportional"],
    "grid": {"env": "turtlebot_gym/TurtleBotNav-v0", "noise": ["tutorial", "documented"]},
    "trainings": {"ppo": {"algo": "ppo", "seeds": 2, "steps": 64}},
}


@fuzzed(60, 500, data=st.data())
def test_studies(data):
    said = replaced(data.draw, STUDY, VALUES)

    def read():
        grid = read_grid(written("f.yaml", dumped(said)))
        for cell in grid.cells():
            for name in grid.trainings:
                grid.trainings_of(name, cell)
        return grid

    answered("studies", read)


MAP = {
    "image": "map.pgm",
    "resolution": 0.05,
    "origin": [0.0, 0.0, 0.0],
    "negate": 0,
    "occupied_thresh": 0.65,
    "free_thresh": 0.196,
    "mode": "trinary",
}
IMAGE = b"P5\n40 30\n255\n" + bytes([0] * 40 + ([0] + [254] * 38 + [0]) * 28 + [0] * 40)


def driven(world):
    """Drive in a world, and return it."""
    env = gym.make("turtlebot_gym/TurtleBotRooms-v0", world=world, lidar="ideal")
    observation, _ = env.reset(seed=1)
    for _ in range(5):
        assert np.isfinite(observation).all()
        observation, reward, *_ = env.step(np.array([1.0, 0.3], np.float32))
        assert math.isfinite(reward)
    return world


@fuzzed(20, 500, content=st.one_of(st.just(IMAGE), mutated(IMAGE)), data=st.data())
def test_maps_are_driven_in(content, data):
    written("map.pgm", content)
    said = replaced(data.draw, MAP, SCALARS) if content == IMAGE else MAP
    answered("maps", lambda: driven(find_world(written("g.yaml", dumped(said)))))


SDF = """<sdf version="1.6"><world name="w"><model name="m"><static>1</static><pose>1 0.5 0 0 0 0.3</pose><link name="l">
<collision name="c"><geometry><cylinder><radius>0.2</radius><length>1</length></cylinder></geometry></collision>
<collision name="d"><pose>-1 -1 0.5 0 0 0</pose><geometry><box><size>0.4 0.2 1</size></box></geometry></collision>
</link></model></world></sdf>"""
NUMBERS = st.sampled_from(["nan", "inf", "-1", "0", "1e300", "1e9", "-1e9", "1e-300", "x", "", "1 2", "1e5", "30"])


@pytest.mark.nightly
@fuzzed(20, 500, number=st.sampled_from(["0.2", "0.4", "-1", "0.5", "0.3", "1"]), other=NUMBERS, damage=mutated(SDF.encode()))
def test_gazebo_worlds_are_driven_in(number, other, damage):
    for content in (SDF.replace(number, other, 1), damage):
        answered("Gazebo worlds", lambda content=content: driven(find_world(written("h.world", content))))


@fuzzed(40, 300, data=st.data())
def test_tuned_baselines(data):
    tuned = {
        "format": "turtlebot-gym-baseline/1",
        "policy": "bearing",
        "dt": 0.1,
        "numbers": {"gain": 2.0},
        "robot": {"name": "burger", **plain(EXAMPLES[Robot])},
    }
    tuned["robot"] = {name: None if limit == math.inf else limit for name, limit in tuned["robot"].items()}
    assert make_policy(str(written("h.json", json.dumps(tuned))))
    said = replaced(data.draw, tuned, VALUES)
    answered("tuned baselines", lambda: make_policy(str(written("h.json", json.dumps(said)))))
