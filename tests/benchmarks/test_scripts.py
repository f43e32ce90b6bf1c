"""Every benchmark can be imported, and the delay by the safety layer is that of rooms which are crossed with and without it."""

from importlib import import_module
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="needs the extra [ros]")
pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")

SCRIPTS = sorted(path.stem for path in (Path(__file__).parents[2] / "benchmarks").glob("*.py"))


@pytest.mark.parametrize("name", SCRIPTS)
def test_it_can_be_imported(name):
    import_module(name)


def test_the_delay_by_the_safety_layer_counts_rooms_crossed_with_and_without_it():
    layered = {"time": [12.0, 60.0, 11.0, 15.0], "success": [True, False, True, True]}
    bare = {"time": [10.0, 9.0, 3.0, 11.0], "success": [True, True, False, True]}
    delay = import_module("rooms_study").later(layered, bare)
    assert delay.value == pytest.approx(3.0)  # of 2 and 4 s
    assert delay.high - delay.value == pytest.approx(12.706, abs=1e-3)  # Student's factor for two numbers, times 1 s
