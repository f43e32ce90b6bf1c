"""Objects of a user's own are found in the working folder by every program, or refused with the true cause."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FILES = {
    "good.py": "from beside import SPEED\n\ndef drive(observation):\n    return [SPEED, 0.0]\n",
    "beside.py": "SPEED = 0.5\n",
    "lacks.py": "import nothing_such\n",
    "lacks_name.py": "from os import nothing_such\n",
    "ends.py": "raise SystemExit(3)\n",
    "folder/__init__.py": "",
}
LOAD = "from turtlebot_gym.plugins import load_object; import sys; print(load_object(sys.argv[1]))"


@pytest.fixture(scope="module")
def load(tmp_path_factory):
    """Load an object in a program as pip installs it: only its own folder, not the working one, is on Python's path."""
    folder, programs = tmp_path_factory.mktemp("mine"), tmp_path_factory.mktemp("bin")
    for name, text in FILES.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
    (programs / "program").write_text(LOAD)
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}

    def loaded(name, *options, at=folder):
        words = [sys.executable, *options, str(programs / "program"), name]
        done = subprocess.run(words, cwd=at, env=environment, capture_output=True, text=True, check=False)
        return done.stdout or done.stderr.splitlines()[-1]

    loaded.folder = folder
    return loaded


def test_a_module_in_the_working_folder_is_found_with_those_beside_it(load):
    assert load("good:drive").startswith("<function drive")


@pytest.mark.sample(3)
@pytest.mark.parametrize(
    ("name", "cause"),
    [
        ("bad:drive", "No module named 'bad', not even in {folder}: start the program in the module's folder, or set"),
        ("folder.bad:drive", "No module named 'folder.bad', 'folder' is {folder}/folder/__init__.py."),
        ("good:dive", "module 'good' ({folder}/good.py) has no attribute 'dive'."),
        ("string:drive", "module 'string' ("),  # a module of Python's, which counts before one's own
        ("lacks:drive", "lacks:drive: ModuleNotFoundError: No module named 'nothing_such' ({folder}/lacks.py, line 1)."),
        ("lacks_name:drive", "lacks_name:drive: ImportError: cannot import name 'nothing_such' from 'os' ("),
        ("ends:drive", "ends:drive: SystemExit: 3 ({folder}/ends.py, line 1)."),
        ("good.py:drive", "'good.py:drive' must be 'module:name' of a Python module, without folders and .py"),
        ("./good:drive", "'./good:drive' must be 'module:name' of a Python module, without folders and .py"),
    ],
)
def test_a_refusal_names_the_true_cause(load, name, cause):
    assert load(name).startswith(f"ValueError: {cause.format(folder=load.folder)}")


def test_a_remedy_is_named_where_the_folder_cannot_be_found(load, tmp_path):
    assert f"not even in {tmp_path}: start the program in" in load("good:drive", at=tmp_path)
    assert "the option -P leaves out the working folder" in load("good:drive", "-P")
