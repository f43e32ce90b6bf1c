"""The cache of compiled functions: how a file is found, and who shares it."""

import os
import runpy
import subprocess
import sys

import pytest

from turtlebot_gym.compiled.values import Untraceable

FUNCTION = """
import numpy as np
from turtlebot_gym.compiled import native, program
from turtlebot_gym.kernel import kernel
from turtlebot_gym.parameters import Noise
from turtlebot_gym.compiled.packing import as_tuple

@kernel
def double(x):
    return 2.0 * x

def function(x, noise):
    return double(x) + 1.0 + 0.0 * noise.odometry.R[0]

made, optimize = [], native.machine_code
native.machine_code = lambda *given: (made.append(1), optimize(*given))[1]
loop = program.compiled(function, "a function")
print([loop(3.0, as_tuple(Noise())) for _ in range(2)][0], len(made))
native.machine_code = optimize
"""
LOADED, COMPILED = ["7.0", "0"], ["7.0", "1"]


def filed(folder, program):
    """Return a file with a program: kernels are compiled from their source."""
    file = folder / "programs" / f"{abs(hash(program))}.py"
    file.parent.mkdir(exist_ok=True)
    file.write_text(program)
    return file


@pytest.fixture
def here(tmp_path, monkeypatch, capsys):
    """Return a function that runs a program in this process, with a cache of its own, and returns what it prints."""
    monkeypatch.setenv("TURTLEBOT_GYM_CACHE_DIR", str(tmp_path))

    def run(program=FUNCTION):
        runpy.run_path(str(filed(tmp_path, program)), run_name=__name__)
        return capsys.readouterr().out.split()

    return run


def start(folder, **environment):
    """Start a process that runs the program with its cache in a folder."""
    command, pipe = [sys.executable, filed(folder, FUNCTION)], subprocess.PIPE
    environment = os.environ | {"TURTLEBOT_GYM_CACHE_DIR": str(folder)} | environment
    return subprocess.Popen(command, stdout=pipe, stderr=pipe, env=environment, text=True)


def test_another_process_loads_what_one_has_compiled_and_is_silent_without_a_terminal(tmp_path):
    for expected, seed in ((COMPILED, "0"), (LOADED, "5")):
        process = start(tmp_path, PYTHONHASHSEED=seed)
        printed, said = process.communicate(timeout=300)
        assert (printed.split(), said) == (expected, "")
        (file,) = (tmp_path / "turtlebot_gym").iterdir()
        assert file.suffix == ".bin"  # no part of a file
        assert file.stat().st_mtime > 1e9  # in use: the oldest are removed
        os.utime(file, (1e9, 1e9))


def test_processes_that_start_together_compile_the_same(tmp_path):
    processes = [start(tmp_path) for _ in range(3)]
    printed = {process.communicate(timeout=300)[0].split()[0] for process in processes}
    assert (printed, len([*(tmp_path / "turtlebot_gym").iterdir()])) == ({"7.0"}, 1)


def test_only_a_change_of_what_a_function_uses_compiles_it_again(here):
    assert here() == COMPILED
    assert here("# one line more\n" + FUNCTION.replace("def double", "def unused(): pass\n@kernel\ndef double")) == LOADED
    assert here(FUNCTION.replace("2.0 * x", "x + x + 0.0")) == COMPILED
    assert here(FUNCTION.replace("@kernel\n", "scale = 2.0\n\n@kernel\n").replace("2.0 * x", "scale * x")) == LOADED
    assert [here(FUNCTION.replace("+ 1.0", "+ 2.0")), here()] == [["8.0", "1"], LOADED]


def test_a_damaged_file_is_compiled_again_and_without_a_folder_it_goes_on(here, tmp_path):
    here()
    (path,) = (tmp_path / "turtlebot_gym").iterdir()
    path.write_bytes(path.read_bytes()[:100])
    assert [here(), here()] == [COMPILED, LOADED]
    path.unlink()
    path.parent.rmdir()
    path.parent.write_text("")
    assert [here(), here()] == [COMPILED, COMPILED]


def test_what_cannot_be_compiled_is_named_with_its_line_and_leaves_no_file(here, tmp_path):
    with pytest.raises(
        Untraceable, match=r"programs.*\.py, line 10 of the kernel 'double', 'return 2.0 \* x\.nothing', cannot be compiled"
    ):
        here(FUNCTION.replace("2.0 * x", "2.0 * x.nothing"))
    assert not (tmp_path / "turtlebot_gym").exists()


def test_files_that_nobody_used_for_long_are_removed(here, tmp_path):
    here()
    (path,) = (tmp_path / "turtlebot_gym").iterdir()
    os.utime(path, (1e9, 1e9))
    assert here(FUNCTION.replace("+ 1.0", "+ 2.0")) == ["8.0", "1"]
    (left,) = (tmp_path / "turtlebot_gym").iterdir()
    assert left != path
