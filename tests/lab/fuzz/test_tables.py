"""Whatever a table holds, it is read, or refused with one line."""

import numpy as np
import pytest
from fuzzing import FOLDER, HEADERS, answered, fuzzed, mutated, table
from hypothesis import strategies as st

from turtlebot_gym_lab.drives import read
from turtlebot_gym_lab.evaluation.replay import replayable


def written(name, content):
    path = FOLDER / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8", "surrogatepass"))
    return path


CELLS = st.sampled_from(["", "nan", "inf", "-1", "1e308", "1e15", "abc", "0x10", "1,2", "\x00", '"', "1_0", "é", "1e-400", "٣"])


def other_cells(draw, text):
    """Return a table with a few cells, lines or names that are others."""
    lines = text.split("\n")
    for _ in range(draw(st.integers(1, 3))):
        if not lines:
            break
        at = draw(st.integers(0, len(lines) - 1))
        how = draw(st.sampled_from(["cell", "cell", "cell", "cut", "twice", "swap", "scale"]))
        cells = lines[at].split(",")
        if how == "cell":
            cells[draw(st.integers(0, len(cells) - 1))] = draw(CELLS)
            lines[at] = ",".join(cells)
        elif how == "cut":
            lines[at] = lines[at][: draw(st.integers(0, len(lines[at])))]
        elif how == "twice":
            lines.insert(at, lines[at])
        elif how == "swap":
            lines[at], lines[-1] = lines[-1], lines[at]
        else:
            factor, column = draw(st.sampled_from([1e-9, 1e-3, 57.3, 1e3, 1e9])), draw(st.integers(0, 5))
            for k in range(1, len(lines)):
                row = lines[k].split(",")
                if column < len(row) and row[column].replace(".", "").replace("-", "").isdigit():
                    row[column] = repr(float(row[column]) * factor)
                    lines[k] = ",".join(row)
    return "\n".join(lines)


COMPONENTS = ["x", "y", "theta", "v", "omega"]
NAMES_OF_SNAPSHOTS = [
    "time",
    *(f"{topic}_{name}" for topic in ("odom", "true_state", "estimate") for name in COMPONENTS),
    *("reference_x", "reference_y", "reference_theta", "cmd_vel_v", "cmd_vel_omega"),
]
SNAPSHOTS = "\n".join(
    [",".join(NAMES_OF_SNAPSHOTS), *(",".join(f"{0.1 * k + 0.01 * j:.3f}" for j in range(21)) for k in range(30))]
)
TABLES = {"snapshots": SNAPSHOTS, **{name: table(header) for name, header in HEADERS.items()}}


def read_as(name, path):
    drive = replayable(read(path)) if name == "replay" else read(path)
    if name != "snapshots":
        assert np.isfinite(drive.time).all()
        assert np.isfinite(drive.twist).all()
        assert (np.diff(drive.time) > 0.0).all()
    return drive


@pytest.mark.parametrize("name", TABLES)
def test_the_tables_are_read(name):
    assert read_as(name, written("i.csv", TABLES[name]))


@pytest.mark.nightly
@fuzzed(100, 3700, name=st.sampled_from(sorted(TABLES)), damaged=st.booleans(), data=st.data())
def test_tables(name, damaged, data):
    content = data.draw(mutated(TABLES[name].encode())) if damaged else other_cells(data.draw, TABLES[name])
    answered("tables", lambda: read_as(name, written("j.csv", content)))
