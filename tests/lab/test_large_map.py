"""A map of 26 million cells is localized in within 1 GB of memory; a larger one than the limit is refused at once."""

import subprocess
import sys

import numpy as np
import pytest

from turtlebot_gym.kernel import HAS_LLVM
from turtlebot_gym_agents.commands.cli import main

ROWS, COLUMNS, SIDE, HALF = 4795, 5474, 0.05, 3.0
MOST = 1_000_000
"""Most memory, kB."""
MEASURED = """
import resource
from turtlebot_gym_agents.commands.cli import main
code = main(["localize", "log.npz", "--map", "map.yaml", "--mount", "0", "0", "0"])
print("peak", resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, code)
"""


def log(path):
    """Write a drive along a square room, with its scans and its truth."""
    x, around = np.linspace(-1.0, 1.0, 60), np.radians(np.arange(180) - 90.0)
    with np.errstate(divide="ignore"):
        ahead = (np.where(np.cos(around) > 0.0, HALF, -HALF) - x[:, None]) / np.cos(around)
        aside = np.where(np.sin(around) > 0.0, HALF, -HALF) / np.sin(around)
    ranges = np.minimum(ahead, aside)
    poses = np.column_stack([x, 0.0 * x, 0.0 * x])
    np.savez(
        path,
        time=0.2 * np.arange(60),
        odometry=poses,
        ranges_cm=np.rint(100.0 * ranges),
        reference_row=np.arange(60),
        reference=poses,
    )


@pytest.mark.nightly
@pytest.mark.skipif(not HAS_LLVM, reason="takes minutes in plain Python")
def test_a_map_of_26_million_cells_is_localized_in_within_a_gigabyte(tmp_path, write_map):
    pixels = np.full((ROWS, COLUMNS), 205, np.uint8)
    row, column, half = ROWS // 2, COLUMNS // 2, round(HALF / SIDE)
    pixels[row - half : row + half + 1, column - half : column + half + 1] = 0
    pixels[row - half + 1 : row + half, column - half + 1 : column + half] = 254
    # The middles of the walls' cells are HALF from the origin.
    write_map(tmp_path, pixels, origin=[-(column + 0.5) * SIDE, -(ROWS - row - 0.5) * SIDE, 0.0], resolution=SIDE)
    log(tmp_path / "log.npz")
    done = subprocess.run([sys.executable, "-c", MEASURED], cwd=tmp_path, capture_output=True, text=True, check=True)
    peak, code = (int(number) for number in done.stdout.rsplit("peak", 1)[1].split())
    assert code == 0, done.stderr
    assert "tracking, % of the rows     │ 100.0" in done.stdout
    assert peak < MOST


def test_a_map_beyond_the_limit_is_refused_and_the_limit_named(tmp_path, write_map, capsys):
    log(tmp_path / "log.npz")
    path = write_map(tmp_path)
    with open(tmp_path / "map.pgm", "wb") as image:  # its pixels are a hole in the file
        image.write(b"P5\n10000 10000\n255\n")
        image.truncate(100_000_018)
    assert main(["localize", str(tmp_path / "log.npz"), "--map", str(path)]) == 2
    (*_, refusal) = capsys.readouterr().err.splitlines()
    assert "it has 10000 x 10000 pixels, more than 30,000,000: cut it" in refusal
