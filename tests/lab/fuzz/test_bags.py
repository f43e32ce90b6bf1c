"""Whatever a bag holds, it is read, or refused with one line."""

import math
import tempfile
from pathlib import Path

import numpy as np
import pytest
from fuzzing import FOLDER, answered, fuzzed, mutated
from hypothesis import strategies as st
from rosbag_messages import ODOMETRY, Plugin, make, odometry, write_bag

from turtlebot_gym_lab.drives import read

NUMBERS = st.one_of(st.floats(width=64), st.sampled_from([math.nan, math.inf, 1e308, -1.0, 0.0, 1e9]))


def bag(rows, *, kinds=(ODOMETRY, ODOMETRY), plugin=Plugin.MCAP):
    """Write a bag with /odom and /ground_truth, and return its file."""
    said = []
    for topic, kind in zip(("/odom", "/ground_truth"), kinds, strict=True):
        for at, row in enumerate(rows):
            time, x, y, w, v, omega, first = (*row, 0.01)[:7]
            message = (
                odometry(time, (x, y, 0.0), (v, omega), variances=(first, 0.0, 0.0)) if kind == ODOMETRY else make(kind, "x")
            )
            if kind == ODOMETRY:
                message.pose.pose.orientation.w = w
            said.append((topic, kind, 100.0 + 0.1 * at, message))
    folder = write_bag(Path(tempfile.mkdtemp(dir=FOLDER)) / "bag", said, plugin=plugin)
    (file,) = [path for path in folder.iterdir() if path.suffix in (".mcap", ".db3")]
    return file


ROWS = [(100.0 + 0.1 * k, 0.02 * k, 0.001 * k, math.cos(0.01 * k), 0.2, 0.02 * math.cos(k)) for k in range(40)]
FILES = {plugin: bag(ROWS, plugin=plugin).read_bytes() for plugin in Plugin}


def read_it(path):
    """Read a bag, or see it refused."""
    drive = answered("bags", lambda: read(path))
    if drive is not None:
        assert np.isfinite(drive.time).all()
        assert np.isfinite(drive.twist).all()


def test_the_bags_are_read():
    for plugin, content in FILES.items():
        path = FOLDER / f"good.{'mcap' if plugin is Plugin.MCAP else 'db3'}"
        path.write_bytes(content)
        assert len(read(path)) == len(ROWS)


@pytest.mark.nightly
@fuzzed(25, 400, data=st.data())
def test_damaged_bags(data):
    plugin = data.draw(st.sampled_from([Plugin.MCAP, Plugin.MCAP, Plugin.SQLITE3]))
    path = FOLDER / f"damaged.{'mcap' if plugin is Plugin.MCAP else 'db3'}"
    path.write_bytes(data.draw(mutated(FILES[plugin])))
    read_it(path)


@pytest.mark.nightly
@fuzzed(15, 200, data=st.data())
def test_bags_whose_messages_say_anything(data):
    rows = [list(row) for row in ROWS]
    for _ in range(data.draw(st.integers(1, 4))):
        at, column = data.draw(st.integers(0, len(rows) - 1)), data.draw(st.integers(1, 6))
        rows[at][column : column + 1] = [data.draw(NUMBERS)]
        rows[at][0] = abs(data.draw(st.sampled_from([rows[at][0], 0.0, 2e9, 99.0])))
    kinds = data.draw(st.sampled_from([(ODOMETRY,) * 2, (ODOMETRY, "std_msgs/msg/String")]))
    read_it(bag(rows, kinds=kinds))
