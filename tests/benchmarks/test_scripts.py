"""Every benchmark can be imported, so what it takes from the package is still there."""

from importlib import import_module
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="needs the extra [ros]")
pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")

SCRIPTS = sorted(path.stem for path in (Path(__file__).parents[2] / "benchmarks").glob("*.py"))


@pytest.mark.parametrize("name", SCRIPTS)
def test_it_can_be_imported(name):
    import_module(name)
