"""IR-SIM, a simulator of robots with LiDARs, in its own virtual environment and process: the peer of `rooms.py`."""

from __future__ import annotations

import json
import subprocess
import venv
from pathlib import Path
from typing import Any

import numpy as np

from harness.peers import Process
from turtlebot_gym.rooms.scene import Scene

PEER = "ir-sim==2.12.0"
_PEER_PROGRAM = """
import json, sys, time
import irsim, numpy
env = irsim.make(sys.argv[1], display=False, disable_all_plot=True, log_level="ERROR")
command = numpy.array([[0.0], [float(sys.argv[2])]])
env.step(command)
print("ready {}", flush=True)
for line in sys.stdin:
    wall, cpu = time.perf_counter(), time.process_time()
    for _ in range(int(line)):
        env.step(command)
    print("turn", json.dumps([time.perf_counter() - wall, time.process_time() - cpu]), flush=True)
"""


def start_peer(folder: Path, scene: Scene, turn: float) -> Process:
    """Start IR-SIM in one of this package's rooms; it is installed if missing.

    Args:
        folder: Folder of its virtual environment.
        scene: The room.
        turn: Turning rate of its command, rad/s.
    """
    python = folder / "bin" / "python"
    if not (folder / "installed").exists():
        venv.create(folder, with_pip=True)
        subprocess.run([str(python), "-m", "pip", "install", "--quiet", PEER], check=True)
        (folder / "installed").touch()
    x, y, half_length, half_width = scene.room.walls.tolist()
    obstacles: list[dict[str, Any]] = [
        {"number": 1, "shape": {"name": "circle", "radius": radius}, "state": [at_x, at_y, 0.0]}
        for at_x, at_y, radius, _, _ in scene.room.circles[: scene.room.counts[0]].tolist()
    ]
    for at_x, at_y, a, b, cosine, sine in scene.room.boxes[: scene.room.counts[1]].tolist():
        shape = {"name": "rectangle", "length": 2.0 * a, "width": 2.0 * b}
        obstacles.append({"number": 1, "shape": shape, "state": [at_x, at_y, float(np.arctan2(sine, cosine))]})
    lidar = {"name": "lidar2d", "range_min": 0.0, "range_max": 3.5, "angle_range": 2.0 * np.pi, "number": 36, "noise": False}
    robot = {"kinematics": {"name": "diff"}, "shape": {"name": "circle", "radius": 0.105}, "sensors": [lidar]}
    world = {"width": 2.0 * half_length, "height": 2.0 * half_width, "offset": [x - half_length, y - half_width]}
    world |= {"step_time": 0.1, "sample_time": 0.1, "collision_mode": "unobstructed"}
    world_file = {"world": world, "robot": [robot | {"state": [0.0, 0.0, 0.0], "goal": [9.0, 9.0, 0.0]}], "obstacle": obstacles}
    (folder / "room.yaml").write_text(json.dumps(world_file))  # JSON is YAML
    command = [str(python), "-c", _PEER_PROGRAM, str(folder / "room.yaml"), str(turn)]
    return Process(command, folder / "log.txt")
