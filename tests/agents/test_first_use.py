"""What the command line imports: little for its help, torch only to train."""

import json
import subprocess
import sys

import pytest

HEAVY = [
    "torch",
    "stable_baselines3",
    "llvmlite",
    "scipy",
    "matplotlib",
    "rich",
    "yaml",
    "onnx",
    "onnxruntime",
]


def loaded(script, heavy=HEAVY):
    """Return which heavy modules a script leaves in memory, in a Python of its own."""
    script += f"\nimport json, sys\nprint(json.dumps([name for name in {heavy} if name in sys.modules]))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.parametrize("arguments", [["--help"], ["train", "--help"], ["evaluate", "--help"]], ids=str)
def test_help_imports_nothing_heavy(arguments):
    script = f"""
from turtlebot_gym_agents.__main__ import main
try:
    main({arguments})
except SystemExit:
    pass
"""
    assert loaded(script) == []
