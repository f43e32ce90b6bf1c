"""The block diagrams, drawn from what the blocks declare; and what the pages show of benchmarks."""

import io
from pathlib import Path

import mkdocs_gen_files
from matplotlib.figure import Figure

from turtlebot_gym_ros.graph.diagram import declared, draw
from turtlebot_gym_ros.nodes import MODES

LOOP = MODES["autonomous"]
GUARDED = (*LOOP, "cmd_vel_guard", "simulated_teleop")
"""On a robot: the guard and a person come in; the simulator stands for the robot."""


def save(path, names, *, size, plain):
    """Draw nodes and what they tell each other into the site."""
    figure = Figure(figsize=size, layout="constrained")
    draw(figure.subplots(), declared(names), plain=plain)
    drawn = io.BytesIO()
    figure.savefig(drawn, format="svg", bbox_inches="tight", facecolor="white", metadata={"Date": None})
    with mkdocs_gen_files.open(path, "wb") as file:
        file.write(drawn.getvalue())


save("concepts/loop.svg", LOOP, size=(8.0, 4.0), plain=True)
save("concepts/graph.svg", LOOP, size=(8.0, 4.0), plain=False)
save("concepts/guarded.svg", GUARDED, size=(9.0, 5.2), plain=False)
for path in (*Path("benchmarks").glob("robustness.*"), *Path("benchmarks").glob("speed.*")):
    with mkdocs_gen_files.open(str(path), "wb") as file:
        file.write(path.read_bytes())
