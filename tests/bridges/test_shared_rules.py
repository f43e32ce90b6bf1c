"""Rules that guard and nodes share stand in both packages, so that each is complete alone: here they are equal."""

from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
GUARD = ROOT / "bridges/cmd_vel_guard/cmd_vel_guard"
BASE = ROOT / "bridges/turtlebot_gym_ros/turtlebot_gym_ros/base"
PAIRS = dict.fromkeys(("sent", "flood", "emergency", "explain"), BASE)
pytestmark = pytest.mark.skipif(not GUARD.exists(), reason="there is no bridges/cmd_vel_guard")


def without_imports(path):
    return [line for line in path.read_text().splitlines() if not line.startswith(("from ", "import "))]


@pytest.mark.parametrize("name", PAIRS)
def test_a_shared_rule_is_equal_in_both_packages(name):
    mine, other = (without_imports(folder / f"{name}.py") for folder in (GUARD, PAIRS[name]))
    assert mine == other
