"""Mutation testing itself: what counts as a mutant, that a seed draws the same ones, and that the project stays as it is."""

import ast
import hashlib
import json
import subprocess
import sys
from pathlib import Path

import pytest

import mutant_tests
import mutants
import mutation

ROOT = Path(__file__).parents[2]
CODE = '''"""A module."""


def area(width: float | None, height: float = 2.0) -> float:
    """Return 1 + 1."""
    if width is None or width < 0.0:
        raise ValueError("no width")
    x = max(width, 1.0)
    return x * height
'''


def test_a_seed_draws_the_same_mutants_and_another_seed_draws_others():
    first, same, other = (mutation.draw("area.py", CODE, 8, seed=seed) for seed in (1, 1, 2))
    assert first == same != other
    assert len(first) == len({mutant.code for mutant in first}) == 8
    assert mutation.draw("other.py", CODE, 8, seed=1) != first


def test_every_mutant_is_another_program():
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


def test_names_of_arguments_and_the_alphabet_make_no_mutants():
    code = "def drives(self, *, phase: str = 'silent') -> bool:\n    return phase == 'active'\n"
    changed = {mutant.now for mutant in mutation.draw("phase.py", code, 1000, seed=0)}
    assert "return phase != 'active'" in changed
    assert not any("/" in now or "<" in now or ">" in now.replace("->", "") for now in changed)


def test_every_caught_exception_can_be_one_that_is_never_raised():
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


def test_every_module_of_the_table_and_all_its_tests_are_there():
    rows = mutants.table(mutants.Config())
    assert len({row.path for row in rows}) == len(rows)
    for row in rows:
        for name, _, test in (place.partition("::") for place in (row.path, *row.tests, *row.without)):
            assert f"def {test}" in (ROOT / name).read_text(encoding="utf-8") or not test, test
    assert sum(row.quota for row in rows) >= 300
    with pytest.raises(SystemExit, match="no_such_module"):
        mutants.table(mutants.Config(only=("no_such_module",)))


def test_every_equivalent_mutant_says_why_and_was_drawn_from_code_that_is_there():
    for (path, _, was, now), why in mutant_tests.equivalents().items():
        assert len(why) > 20, (path, was)
        assert now != was
        code = " ".join((ROOT / path).read_text(encoding="utf-8").split())
        assert " ".join(was.split()) in code, f"{path}: {was}"


def entries_of(count=1000):
    return [
        mutants.Entry(mutant.path, mutant.function, mutant.operator, mutant.was, mutant.now)
        for mutant in mutation.draw("area.py", CODE, count, seed=0)
    ]


def test_a_listed_mutant_is_found_again_also_where_its_function_has_moved_to():
    by_text = {(mutant.was, mutant.now): mutant.code for mutant in mutation.draw("area.py", CODE, 1000, seed=0)}
    inside = "class Shape:\n" + "".join(f"    {line}\n" if line else "\n" for line in CODE.split("\n")[3:])
    moved = {"other.py": "def area():\n    return 1\n", "shapes.py": f"import math\n\n\n{inside}"}
    for entry in entries_of():
        same, other = (mutants.find(entry, sources) for sources in ({"area.py": CODE}, moved))
        assert ast.dump(ast.parse(same.code)) == ast.dump(ast.parse(by_text[entry.was, entry.now]))
        assert (same.path, same.function) == ("area.py", "area")
        assert (other.path, other.function) == ("shapes.py", "Shape.area")
        assert ast.dump(ast.parse(other.code)) != ast.dump(ast.parse(moved["shapes.py"]))


def test_a_listed_mutant_is_gone_where_its_code_has_changed_or_is_not_unique():
    entry = mutants.Entry("area.py", "area", "", "return x * height", "return x / height")
    assert mutants.find(entry, {"area.py": CODE.replace("* height", "* abs(height)")}) is None
    assert mutants.find(entry, {"area.py": CODE.replace("def area", "def volume")}) is None
    assert mutants.find(entry, {"a.py": CODE, "b.py": CODE}) is None


def test_a_list_has_what_died_and_reads_back(tmp_path):
    (tmp_path / "area.py").write_text(CODE)
    everything = mutants.recorded(tmp_path, {"area.py": 9}, 3, ())
    survived = everything[0]._asdict() | {"line": 7}
    died = mutants.recorded(tmp_path, {"area.py": 9}, 3, [survived])
    assert died == everything[1:]
    mutants.write_list(tmp_path / "died.json", died)
    assert mutants.read_list(tmp_path / "died.json") == died


@pytest.mark.slow
def test_a_run_lists_who_survived_and_leaves_the_project_as_it_is(tmp_path):
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
