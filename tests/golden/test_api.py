"""Nothing that users hold on to has gone: `api` lists it."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("rclpy")
API = Path(__file__).parent / "api.py"
STORED = json.loads((Path(__file__).parent / "api.json").read_text())
GONE = {
    "exports.turtlebot_gym.World",
    "commands.export.--vec-normalize",
    *(f"commands.train.--{name}" for name in ("checkpoint-seconds", "no-resume", "resume", "seconds")),
    *(f"commands.replay.--columns.{name}" for name in ("time", "v", "omega", "x", "y", "theta")),
}
"""What has gone on purpose."""


def paths(value, path=""):
    """Yield the dotted path of each name in nested mappings and lists; defaults of parameters count as names."""
    if isinstance(value, dict):
        for key, item in value.items():
            yield from paths(item, f"{path}.{key}" if path else key)
    elif isinstance(value, list):
        yield from (f"{path}.{item}" for item in value)
    else:
        yield f"{path}={value}"


def test_names_that_users_hold_on_to_are_all_there():
    environment = {**os.environ, "COLUMNS": "200", "TURTLEBOT_GYM_PLAIN": "1"}  # nothing is driven: compiling would take longer
    shown = subprocess.run([sys.executable, API], env=environment, check=True, capture_output=True, text=True).stdout
    now = json.loads(shown)
    satellites = {name: flags for name, flags in STORED["satellites"].items() if name in now["satellites"]}
    missing = set(paths(STORED | {"satellites": satellites})) - set(paths(now)) - GONE
    assert not missing, "\n".join(sorted(missing))


def test_a_name_that_goes_is_noticed():
    fewer = json.loads(json.dumps(STORED))
    fewer["commands"]["train"].remove("--until")
    del fewer["nodes"]["kalman_filter"]["parameters"]["filter"]
    missing = set(paths(STORED)) - set(paths(fewer))
    assert len(missing) == 2
