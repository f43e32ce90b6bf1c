"""The loop that is read first: short, few calls above the physics, and without a second one beside it in plain Python."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import turtlebot_gym

READ_FIRST = ("values.py", "heart.py", "systems/open_ground.py", "estimation/ekf.py", "tasks.py")
TRACE = """
import json, sys
import gymnasium as gym, numpy as np

env = gym.make("turtlebot_gym:turtlebot_gym/TurtleBot{task}-v0").unwrapped
env.reset(seed=1)
stack, above = [], []

def trace(frame, event, argument):
    if event == "call":
        stack.append(frame.f_code.co_qualname if hasattr(frame.f_code, "co_qualname") else frame.f_code.co_name)
        if frame.f_code.co_name == "_move" and not above:
            above.extend(stack)
    elif event == "return" and stack:
        stack.pop()

sys.setprofile(trace)
env.step(np.zeros(2, np.float32))
sys.setprofile(None)
print(json.dumps(above))
"""


@pytest.mark.parametrize("task", ["Nav", "Rooms"])
def test_in_plain_python_the_plant_moves_four_calls_below_a_step_of_the_environment(task):
    environment = {**os.environ, "TURTLEBOT_GYM_PLAIN": "1"}
    script = TRACE.format(task=task)
    run = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True)
    calls = json.loads(run.stdout)
    assert calls[0].endswith("step")
    assert len(calls) - 1 <= 4, calls


def test_what_contributors_read_first_is_less_than_a_thousand_lines():
    folder = Path(turtlebot_gym.__file__).parent
    assert sum(len((folder / name).read_text(encoding="utf-8").splitlines()) for name in READ_FIRST) < 1000
    contributing = (Path(__file__).parents[2] / "CONTRIBUTING.md").read_text(encoding="utf-8")
    places = [contributing.index(f"`{name}`") for name in READ_FIRST]
    assert places == sorted(places)
