"""The cache of compiled functions: what a file is found by, and who shares it."""

import os
import runpy
import subprocess
import sys
from dataclasses import replace
from types import FunctionType

import pytest

from turtlebot_gym.compiled import files
from turtlebot_gym.compiled.files import fingerprint
from turtlebot_gym.compiled.loop import loops_of
from turtlebot_gym.compiled.proof import Case
from turtlebot_gym.compiled.values import Untraceable
from turtlebot_gym.estimation.ekf import EXTENDED_KALMAN
from turtlebot_gym.kernel import in_loops
from turtlebot_gym.systems import open_ground


def with_source(source, file="here.py", **names):
    """Return the function ``f`` of a source text, as if it were in a file."""
    scope = dict(names)
    exec(compile(source, file, "exec"), scope)
    return scope["f"]


HELPER = "def helper(x):\n    return x + 1.0\n"
SOURCE = "def f(x):\n    return helper(x) * FACTOR\n"


@pytest.mark.parametrize(
    ("source", "names", "is_same"),
    [
        pytest.param(HELPER + SOURCE.replace("*", "/"), {}, False, id="operator"),
        pytest.param(HELPER + SOURCE, {"FACTOR": 3.0}, False, id="constant"),
        pytest.param(HELPER.replace("1.0", "1.5") + SOURCE, {}, False, id="constant of a helper"),
        pytest.param(HELPER.replace("+", "-") + SOURCE, {}, False, id="operator of a helper"),
        pytest.param(HELPER + SOURCE, {"FACTOR": (2.0,)}, False, id="type"),
        pytest.param("# a comment\n\n" + HELPER + "\n\n\n" + SOURCE, {}, True, id="comments and lines"),
        pytest.param('def helper(x):\n    """Add."""\n    return x + 1.0\n' + SOURCE, {}, True, id="docstring"),
        pytest.param("def helper(x):\n    return x + None\n" + SOURCE, {}, False, id="none"),
        pytest.param(HELPER + SOURCE, {"UNUSED": 5.0, "unused": abs}, True, id="other names"),
    ],
)
def test_a_change_of_anything_that_a_function_reaches_and_of_nothing_else_changes_its_fingerprint(source, names, is_same):
    first, second = with_source(HELPER + SOURCE, FACTOR=2.0), with_source(source, "there.py", **{"FACTOR": 2.0} | names)
    assert (fingerprint(first) == fingerprint(second)) is is_same


def test_it_reaches_through_closures_and_modules(monkeypatch):
    import turtlebot_gym.models.angles as module

    def outer(inner):
        return lambda x: inner(x)

    first, second = outer(with_source("def f(x):\n    return x\n")), outer(with_source("def f(x):\n    return -x\n"))
    assert fingerprint(first) != fingerprint(second)
    through = with_source("def f(x):\n    return module.wrap(x)\n", module=module)
    before = fingerprint(through)
    monkeypatch.setattr(module, "wrap", lambda angle: angle)
    assert fingerprint(through) != before


def test_it_reaches_into_comprehensions():
    source = HELPER + "def f(x):\n    return [helper(y) * FACTOR for y in x]\n"
    changed = (source, 2.0), (source, 3.0), (source.replace("+", "-"), 2.0)
    assert len({fingerprint(with_source(text, FACTOR=factor)) for text, factor in changed}) == 3


def test_the_loop_that_stands_for_a_function_of_arrays_is_a_part_of_its_fingerprint():
    prints = set()
    for step in ("+ 1.0", "- 1.0"):
        of_arrays, loop = (with_source(f"def f(x):\n    return x {rest}\n") for rest in ("+ 1.0", step))
        prints.add(fingerprint(with_source("def f(x):\n    return helper(x)\n", helper=in_loops(loop)(of_arrays))))
    assert len(prints) == 2


def copied(function):
    """Return a kernel with one more constant."""
    code = function.__code__.replace(co_consts=(*function.__code__.co_consts, 0.125))
    return FunctionType(code, function.__globals__, function.__name__, None, function.__closure__)


def test_every_kernel_of_a_step_is_part_of_its_fingerprint():
    system = open_ground(EXTENDED_KALMAN)
    odometry = system.sensors[0]._replace(sense=copied(system.sensors[0].sense))
    names, goal = ("move", "estimate", "judge"), replace(system.terms[0], of=copied(system.terms[0].of))
    changed = [system.with_sensor(odometry), *(system._replace(**{name: copied(getattr(system, name))}) for name in names)]
    changed.append(system.with_observation(goal, *system.terms[1:]))
    prints = {loops_of(kind, Case((), 1)).step.identity for kind in (system, *changed)}
    assert len(prints) == 6


# Files and processes.

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
    with pytest.raises(Untraceable, match=r"line 10 of the kernel 'double', 'return 2.0 \* x\.nothing', cannot be compiled"):
        here(FUNCTION.replace("2.0 * x", "2.0 * x.nothing"))
    assert not (tmp_path / "turtlebot_gym").exists()


def test_files_that_nobody_used_for_the_longest_time_are_removed(tmp_path, monkeypatch):
    for age in range(5):
        (tmp_path / f"{age}.bin").write_bytes(b"x" * 100)
        os.utime(tmp_path / f"{age}.bin", (1e9 - age, 1e9 - age))
    monkeypatch.setattr(files, "MOST_BYTES", 250)
    files._tidy(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["0.bin", "1.bin"]
