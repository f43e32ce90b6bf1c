"""The configurations of cosmic-ray name modules and tests that exist."""

import re
from pathlib import Path

import pytest
import tomllib

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("path", sorted((ROOT / "benchmarks").glob("cosmic_ray_*.toml")), ids=lambda path: path.stem)
def test_modules_and_tests_exist(path):
    config = tomllib.loads(path.read_text(encoding="utf-8"))["cosmic-ray"]
    tests = re.findall(r"tests/\S+\.py", config["test-command"])
    assert tests
    assert not [name for name in (*config["module-path"], *tests) if not (ROOT / name).is_file()]
