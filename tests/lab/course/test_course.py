"""The exercises: an untouched, a half right and a right solution of each is recognized."""

import shutil
from pathlib import Path

import pytest

from turtlebot_gym_agents.commands.cli import main
from turtlebot_gym_lab.commands.course import NUMBERS
from turtlebot_gym_lab.course.checks import CHECKS

SOLUTIONS = Path(__file__).parent / "solutions"
HALF = {
    1: ("wrapped(z[2] - x[2])", "z[2] - x[2]", [True, False, True, True, False]),
    2: ("*np.var(slip, axis=0).tolist()", "*(np.var(slip, axis=0) * (1.0, 0.04)).tolist()", [True, False, False, True]),
    3: ("margin=0.03, sight=0.8", "", [True, False, True]),
    4: (
        "if pressed:\n            self.last_press = now",
        "self.last_press = now if pressed else -math.inf",
        [True, True, True, True, False, False],
    ),
}
"""A replacement in each right solution, and which of its checks are right after it."""


def checked(path, capsys):
    """Return the status, and whether each check is right."""
    try:
        status = main(["check", str(path)])
    except SystemExit as stop:
        status = stop.code
    printed = capsys.readouterr()
    assert not printed.err, printed.err
    *lines, last = printed.out.splitlines()
    right = [line.startswith("  right") for line in lines]
    assert last == f"{sum(right)} of {len(lines)} are right."
    return status, right


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("number", [pytest.param(n, marks=[pytest.mark.nightly] * (n == 3)) for n in NUMBERS])
def test_a_right_solution_is_right_and_its_code_is_not_in_the_package(number, capsys):
    status, right = checked(SOLUTIONS / f"exercise{number}.py", capsys)
    assert (status, right) == (0, [True] * len(CHECKS[number]))


@pytest.mark.parametrize("number", [pytest.param(n, marks=[pytest.mark.nightly] * (n == 3)) for n in HALF])
def test_of_half_a_solution_half_is_right(number, here, capsys):
    whole = (SOLUTIONS / f"exercise{number}.py").read_text(encoding="utf-8")
    before, after, expected = HALF[number]
    assert before in whole
    (here / "half.py").write_text(whole.replace(before, after), encoding="utf-8")
    assert checked(here / "half.py", capsys) == (1, expected)


@pytest.mark.parametrize("number", [pytest.param(n, marks=[pytest.mark.nightly] * (n == 3)) for n in NUMBERS])
def test_an_untouched_exercise_is_not_right(number, here, capsys):
    exercise = here / f"exercise{number}.py"
    with pytest.raises(SystemExit):
        main(["check", str(exercise)])
    assert "it is written. Fill in its gaps, and check it again." in capsys.readouterr().out
    before = exercise.read_bytes()
    status, right = checked(exercise, capsys)
    assert status == 1
    assert not all(right)
    assert exercise.read_bytes() == before  # not written over


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "name the FILE.py to check; exercise1.py to exercise4.py are written where they are missing."),
        (["nowhere.py"], "There is no file 'nowhere.py'; exercise1.py to exercise4.py are written where they are missing."),
        (["broken.py"], "broken.py: SyntaxError"),
        (["other.py"], "EXERCISE must be one of 1, 2, 3, 4, got None."),
    ],
)
def test_a_file_that_is_not_a_solution_is_refused_in_one_line(arguments, message, here, capsys):
    (here / "broken.py").write_text("def (")
    (here / "other.py").write_text("x = 1")
    assert main(["check", *arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert message in line


def test_an_error_in_a_solution_is_a_hint_with_its_line(here, capsys):
    shutil.copy(SOLUTIONS / "exercise1.py", here / "mine.py")
    text = (here / "mine.py").read_text(encoding="utf-8").replace("return np.array([", "return np.nothing([")
    (here / "mine.py").write_text(text, encoding="utf-8")
    with pytest.raises(SystemExit):
        main(["check", "mine.py"])
    out = capsys.readouterr().out
    assert "AttributeError: module 'numpy' has no attribute 'nothing'" in out
    assert "mine.py, line 13)" in out
