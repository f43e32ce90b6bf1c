"""What is declared: rules and defaults of all parameters, and the numbers of all presets.

python tests/golden/declared.py > tests/golden/declared.json
"""

import json
import sys
from dataclasses import MISSING, asdict, fields, is_dataclass
from typing import Any

from turtlebot_gym import FixNoise, Noise, OdometryNoise, ProcessNoise, Robot, Task
from turtlebot_gym.localization.tuning import LocalizerTuning
from turtlebot_gym.parameters import FilterTuning, Gated, Kalman
from turtlebot_gym.plants import MujocoBurger
from turtlebot_gym.presets import FIXES, NOISES, TUTORIAL_FILTER, make_filter
from turtlebot_gym.robots import ROBOTS
from turtlebot_gym.rooms.lidar import LIDARS, Lidar
from turtlebot_gym.rooms.rules import ROOMS, RoomRules
from turtlebot_gym.systems.imu import IMUS, ImuNoise
from turtlebot_gym.tasks import TASKS
from turtlebot_gym.validation import Numbers, rules
from turtlebot_gym_agents.policies.baselines import POLICIES, default_numbers

CLASSES = (
    Robot,
    Noise,
    ProcessNoise,
    OdometryNoise,
    FixNoise,
    ImuNoise,
    FilterTuning,
    Kalman,
    Gated,
    Task,
    RoomRules,
    Lidar,
    LocalizerTuning,
    MujocoBurger,
)
PRESETS = {
    "robots": ROBOTS,
    "noises": NOISES,
    "fixes": FIXES,
    "gyros": IMUS,
    "lidars": LIDARS,
    "rooms": ROOMS,
    "tasks": TASKS,
    "filters": {"tutorial": TUTORIAL_FILTER, "gyro": make_filter("gyro", NOISES["clean"], imu=IMUS["mpu9250"])},
}


def of_class(kind: type) -> dict[str, Any]:
    """Return the rules of a parameter class in words, and its defaults."""
    assert is_dataclass(kind)
    defaults = {item.name: item.default for item in fields(kind) if item.default is not MISSING}
    words = {name: f"{rule}: {rule.each}" if isinstance(rule, Numbers) else str(rule) for name, rule in rules(kind).items()}
    words = {name: text.replace(", ".join(ROBOTS), "the presets") for name, text in words.items()}
    return {"rules": words, "defaults": defaults}


def of_nodes() -> dict[str, Any]:
    """Return the same for the parameters of all nodes."""
    from turtlebot_gym_ros.nodes import BLOCKS, load
    from turtlebot_gym_ros.recording import logger

    classes = {name: load(name).Params for name in BLOCKS} | {"data_logger": logger.Parameters}
    return {name: of_class(kind) for name, kind in classes.items()}


def snapshot() -> dict[str, Any]:
    """Return all of it, as JSON holds it."""
    policies = {
        name: {
            "ranges": {number: repr(between) for number, between in kind.ranges().items()},
            "defaults": default_numbers(name),
        }
        for name, kind in POLICIES.items()
    }
    classes = {kind.__name__: of_class(kind) for kind in CLASSES}
    everything = {"classes": classes, "presets": PRESETS, "nodes": of_nodes(), "policies": policies}
    return json.loads(json.dumps(everything, default=asdict), parse_constant=str)


if __name__ == "__main__":
    json.dump(snapshot(), sys.stdout, indent=1)
    print()
