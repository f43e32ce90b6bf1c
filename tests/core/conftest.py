"""Programs in processes of their own."""

import json
import os
import subprocess
import sys

import pytest


@pytest.fixture(scope="session")
def run():
    """Return a function that runs a program in a Python of its own, and returns what it prints last as JSON."""

    def run(program, *arguments, path=None, **environment):
        command = [sys.executable, "-W", "error", "-c", program, *map(str, arguments)]
        given = {key: str(value) for key, value in environment.items()} | ({"PYTHONPATH": str(path)} if path else {})
        done = subprocess.run(command, env=os.environ | given, capture_output=True, text=True, cwd=path, timeout=300)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout.splitlines()[-1])

    return run
