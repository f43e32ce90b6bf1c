"""Mutation testing itself: what counts as a mutant, that a seed draws the same ones, and that the project stays as it is."""

import ast
import hashlib
import json
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CODE = '''"""A module."""


def area(width: float | None, height: float = 2.0) -> float:
    """Return 1 + 1."""
    if width is None or width < 0.0:
        raise ValueError("no width")
    x = max(width, 1.0)
    return x * height
'''


@pytest.fixture
def mutation(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    return import_module("mutation")


@pytest.fixture
def mutants(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    return import_module("mutants")


def test_a_seed_draws_the_same_mutants_and_another_seed_draws_others(mutation):
    one, same, other = (mutation.draw("area.py", CODE, 8, seed=seed) for seed in (1, 1, 2))
    assert one == same != other
    assert len(one) == len({mutant.code for mutant in one}) == 8
    assert mutation.draw("other.py", CODE, 8, seed=1) != one


def test_every_mutant_is_another_program(mutation):
    every = mutation.draw("area.py", CODE, 1000, seed=0)
    assert 15 < len(every) < 60
    for mutant in every:
        assert ast.dump(ast.parse(mutant.code)) != ast.dump(ast.parse(CODE))
        assert (mutant.path, mutant.function) == ("area.py", "area")
        assert mutant.was in " ".join(CODE.split())
        assert "def area(width: float | None" in mutant.code  # annotations have no effect
        assert '"""Return 1 + 1."""' in mutant.code  # nor do docstrings
        assert CODE.splitlines()[mutant.line - 1].strip() == mutant.was
    changed = {mutant.now for mutant in every}
    assert {"return x / height", "return y * height", "x = min(width, 1.0)", "x = max(width, 0.5)", "pass"} <= changed
    assert "if width is None or width <= 0.0:" in changed
    assert "def area(width: float | None, height: float = 4.0) -> float:" in changed


def test_names_of_arguments_and_the_alphabet_make_no_mutants(mutation):
    code = "def drives(self, *, phase: str = 'silent') -> bool:\n    return phase == 'active'\n"
    changed = {mutant.now for mutant in mutation.draw("phase.py", code, 1000, seed=0)}
    assert "return phase != 'active'" in changed
    assert not any("/" in now or "<" in now or ">" in now.replace("->", "") for now in changed)


def test_every_caught_exception_can_be_one_that_is_never_raised(mutation):
    code = """
try:
    read()
except (json.JSONDecodeError, OSError, KeyError):
    pass
except ValueError as error:
    pass
except (TypeError):
    pass
except numpy.linalg.LinAlgError:
    pass
"""
    changed = {mutant.now for mutant in mutation.draw("read.py", code, 1000, seed=0)}
    assert {
        "except (NeverRaised, OSError, KeyError):",
        "except (json.JSONDecodeError, NeverRaised, KeyError):",
        "except (json.JSONDecodeError, OSError, NeverRaised):",
        "except NeverRaised as error:",
        "except (NeverRaised):",
        "except NeverRaised:",
    } <= changed


def test_every_module_of_the_table_and_all_its_tests_are_there(mutants):
    rows = mutants.table(mutants.Config())
    assert len({row.path for row in rows}) == len(rows)
    for row in rows:
        for name in (row.path, *(test.partition("::")[0] for test in (*row.tests, *row.without))):
            assert (ROOT / name).is_file(), name
    assert sum(row.quota for row in rows) >= 300
    with pytest.raises(SystemExit, match="no_such_module"):
        mutants.table(mutants.Config(only=("no_such_module",)))


def test_every_equivalent_mutant_says_why_and_was_drawn_from_code_that_is_there(mutants):
    for (path, _, was, now), why in mutants.equivalents().items():
        assert len(why) > 20, (path, was)
        assert now != was
        code = " ".join((ROOT / path).read_text(encoding="utf-8").split())
        assert " ".join(was.split()) in code, f"{path}: {was}"


@pytest.mark.slow
def test_a_run_lists_who_survived_and_leaves_the_project_as_it_is(mutants, tmp_path):
    def state():
        listed = subprocess.run(["git", "-C", str(ROOT), "ls-files"], capture_output=True, text=True, check=True).stdout
        return {name: hashlib.sha256((ROOT / name).read_bytes()).hexdigest() for name in listed.split("\n") if name}

    before = state()
    command = [sys.executable, str(ROOT / "benchmarks/mutants.py"), "--only", "robots", "--quota", "6"]
    subprocess.run([*command, "--json", str(tmp_path / "mutants.json")], check=True, capture_output=True)
    assert state() == before
    content = json.loads((tmp_path / "mutants.json").read_text())
    [(name, row), (total, same)] = content["modules"].items()
    assert (name, total) == ("turtlebot_gym/robots.py", "all")
    assert row == same
    assert row["mutants"] + row["equivalent"] == 6
    assert row["killed"] + row["timeout"] + row["survived"] == row["mutants"]
    assert len(content["survived"]) == row["survived"]
