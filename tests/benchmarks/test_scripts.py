"""Every benchmark can be imported, so what it takes from the package is still there; and a quick one is run."""

from importlib import import_module
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="needs the extra [ros]")
pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")

SCRIPTS = sorted(path.stem for path in (Path(__file__).parents[2] / "benchmarks").glob("*.py"))


@pytest.mark.parametrize("name", SCRIPTS)
def test_it_can_be_imported(name):
    import_module(name)


def test_rules_of_arrival_are_compared_on_drives_that_do_not_end():
    arrival = import_module("arrival")
    rules = arrival.compare("tutorial", arrival.Config(drives=20))
    assert rules.keys() == arrival.RULES.keys()
    assert rules["within 0.15 m"]["later"].value == 0.0 < rules["within 0.08 m"]["later"].value
