"""The short ways of the start page, by the letter, in an empty folder with a fresh clone: how many commands, and how long."""

import json
import math
import os
import shlex
import signal
import subprocess
import time

import pytest
import yaml
from pages import ROOT, blocks_of, environment

pytest.importorskip("rclpy", reason="needs the extra [ros]")
pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")
pytestmark = [
    pytest.mark.nightly,
    pytest.mark.skipif(not (ROOT / ".git").exists(), reason="needs a clone of the repository"),
]
FOLDERS = (".", "agents", "bridges/turtlebot_gym_ros", "bridges/cmd_vel_guard", "lab")
POLICY, GRAPH, FILTER = "train ", "bringup --speed 1", "evaluate --filter "
"""What the first command of each way has in it."""
TOOL = "python -m turtlebot_gym_ros"


def commands_of(first):
    """Return the commands of the block on the start page that begins with one."""
    (block,) = (block for block in blocks_of(ROOT / "docs/start.md") if first in block.text.partition("\n")[0])
    return block.text.splitlines()


@pytest.fixture(scope="module")
def clone(tmp_path_factory):
    folder = tmp_path_factory.mktemp("clone") / "turtlebot_gym"
    subprocess.run(["git", "clone", "-q", str(ROOT), str(folder)], check=True)
    return folder


@pytest.fixture
def walk(clone, tmp_path, record_property):
    """Run commands in an empty folder, one after the other, and tell their seconds."""
    known = environment()
    variables = {**known, "PYTHONPATH": os.pathsep.join(str(clone / folder) for folder in FOLDERS)}
    variables["ROS_DOMAIN_ID"] = str(60 + os.getpid() % 40)
    seconds, running = {}, []

    def run(command, *, wait=True):
        begun = time.perf_counter()
        words = shlex.split(command)
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE} if wait else {"stdout": subprocess.DEVNULL}
        process = subprocess.Popen(words, cwd=tmp_path, env=variables, text=True, **pipes)
        running.append(process)
        if not wait:
            seconds[command] = 0.0
            return process
        out, error = process.communicate(timeout=900)
        seconds[command] = round(time.perf_counter() - begun, 1)
        assert process.returncode == 0, f"{command}\n{out}\n{error}"
        return out

    yield run, tmp_path
    for process in running:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
            process.wait(20)
    record_property("seconds", json.dumps(seconds))
    print(json.dumps(seconds, indent=2))


def test_two_commands_lead_to_an_own_policy_and_a_third_to_the_live_graph(walk):
    run, folder = walk
    train, evaluate, drive = commands_of(POLICY)
    run(train)
    assert (folder / "runs/square/policy.onnx").is_file()
    assert "runs/square/policy.onnx" in run(evaluate).replace("\n", "")
    assert "of 4" in run(drive)


def test_three_commands_lead_to_a_robot_that_goes_where_one_tells_it(walk):
    run, _ = walk
    bringup, enable, goal = commands_of(GRAPH)
    run(bringup, wait=False)
    run(f"{TOOL} topics velocity_controller/state --wait 60")  # a person sees that the graph has started
    assert "enabled" in run(enable).splitlines()[-1]
    run(goal)
    for _ in range(60):
        if "done" in run(f"{TOOL} echo velocity_controller/state --once"):
            break
    place = yaml.safe_load(run(f"{TOOL} echo true_state --once --field pose.pose.position").removesuffix("---\n"))
    assert math.dist((place["x"], place["y"]), (1.0, 0.5)) < 0.3


def test_one_command_and_one_file_lead_to_an_own_filter_beside_ours(walk):
    run, folder = walk
    (file,) = (block for block in blocks_of(ROOT / "docs/howto/filter.md") if block.title == "unscented.py")
    (folder / file.title).write_text(file.text)
    (command,) = commands_of(FILTER)
    out = run(command)
    assert "matched" in out
    assert "Unscented" in out
