"""The fuzz tests' helpers, which are no tests, and the count of the inputs."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))


def pytest_terminal_summary(terminalreporter):
    """Print how many inputs were taken and refused."""
    counted = sys.modules["fuzzing"].COUNTED if "fuzzing" in sys.modules else {}
    for kind, number in sorted(counted.items()):
        terminalreporter.write_line(f"fuzz: {kind}: {number}")
    if counted:
        terminalreporter.write_line(f"fuzz: {sum(counted.values())} inputs")
