"""Tables in the terminal: no number is cut at 80 columns, whatever the table, and none is lost."""

import json
import re
from io import StringIO

import numpy as np
import pytest
from optuna.trial import TrialState, create_trial
from rich.cells import cell_len
from rich.console import Console
from rich.table import Table

from turtlebot_gym_agents.commands.cli import main
from turtlebot_gym_agents.commands.learning import _search_table
from turtlebot_gym_agents.commands.tables import _groups, _Need, _widths, fitted

WIDTH = 80


def shown(tables, width=WIDTH, keys=None):
    """Return the lines of tables in a terminal of a width."""
    console = Console(width=width, record=True, file=StringIO())
    for table in tables:
        console.print(*fitted(table, width, keys=keys))
    lines = console.export_text().splitlines()
    assert max(map(cell_len, lines)) <= width
    return lines


def require_whole(lines, tables):
    """Each number of the tables stands on a line as a whole, and nothing is cut."""
    text = "\n".join(lines)
    assert "…" not in text
    for table in tables:
        for column in table.columns:
            for cell in column.cells:
                for number in re.findall(r"[-+]?\d[\d,.e+-]*", str(cell)):
                    assert number in text


def numbers(rows, columns):
    table = Table("policy", *(f"figure {at}, m" for at in range(columns)), title="drives", caption="in metres")
    for at in range(rows):
        table.add_row(f"policy-{at}", *(f"{10.0 * at + column:.1f} ({at}.0, {column}.0)" for column in range(columns)))
    return table


@pytest.mark.parametrize("width", [30, 40, 80, 120, 200])
def test_each_part_has_the_keys_and_sections_and_each_column_stands_once(width):
    table = numbers(3, 9)
    table.rows[0].end_section = True
    parts = fitted(table, width)
    assert [column.header for part in parts for column in part.columns[1:]] == [column.header for column in table.columns[1:]]
    for part in parts:
        assert [*part.columns[0].cells] == [*table.columns[0].cells]
        assert [row.end_section for row in part.rows] == [True, False, False]
    assert (parts[0].title, parts[-1].caption) == ("drives", "in metres")
    require_whole(shown([table], width), [table])
    assert (parts == [table]) == (width == 200)
    console = Console(width=width, record=True, file=StringIO())
    console.print(table)
    assert ("12.0 (1.0, 2.0)" in console.export_text()) == (width == 200)  # rich alone would cut it


@pytest.mark.parametrize(
    "cell",
    ["99.9 (99.6, 100.0)", "10.36 ± 0.28", "-0.21", "1,000,000", "1.5e-05", "0.0123 to 0.0456 *", "99.8%", "12 of 40", "-inf"],
)
def test_a_cell_of_numbers_stays_on_its_line(cell):
    table = Table("setting", "policy", *(f"figure {at} of several" for at in range(5)))
    table.add_row("turtlebot_gym/TurtleBotSquare-v0", "rotate-drive-rotate, 3 trainings", *[cell] * 5)
    assert "\n".join(shown([table], 60, keys=2)).count(cell) == 5


def test_texts_and_headings_wrap_between_words_and_paths_anywhere_but_intervals_do_not():
    table = Table("name", "a long heading of a narrow column", "interval", "remedy", "file")
    path = "/a/" + 30 * "long/" + "policy.onnx"
    table.add_row("alpha", "1", "0.0123 to 0.0456 *", "drive straight on for ten metres and more, both ways", path)
    lines = shown([table], 70)
    assert any("0.0123 to 0.0456 *" in line for line in lines)
    assert any(re.search(r"\bdrive\b", line) for line in lines)
    assert "…" not in "".join(lines)


def rows_of(lines, name):
    """Return the numbers of the rows that begin with a name, of all parts."""
    pattern = rf"[│┃]\s*{re.escape(name)}\s*[│┃](.*)"
    return [float(number) for line in lines if (row := re.match(pattern, line)) for number in re.findall(r"-?\d+\.\d+", row[1])]


def test_evaluate(monkeypatch, capsys, tmp_path):
    monkeypatch.setenv("COLUMNS", str(WIDTH))
    path = tmp_path / "result.json"
    arguments = ["--policy", "proportional", "bearing", "--episodes", "20", "--details"]
    assert main(["evaluate", *arguments, "--json", str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(cell_len(line) for line in lines if re.match("[┏┡├└│┃]", line)) <= WIDTH
    assert "…" not in "".join(lines)
    for run in json.loads(path.read_text())["runs"]:
        printed, summary = rows_of(lines, run["label"]), run["summary"]
        for value in (100.0 * np.array([*summary["success"].values()])).round(1):
            assert value in printed
        assert round(summary["effort"]["value"], 2) in printed
        assert round(float(np.mean(run["episodes"]["odometry"]["heading_max"])), 3) in printed


def test_a_search_shows_its_best_trials():
    trials = [create_trial(state=TrialState.COMPLETE, value=float(at)) for at in range(9)]
    for number, trial in enumerate(trials):
        trial.number = number
    table = _search_table([*trials, create_trial(state=TrialState.FAIL)], title="")
    assert [*table.columns[0].cells] == ["8", "7", "6", "5", "4"]


def test_parts_are_as_even_as_possible():
    # Two keys of 3 and 4, five columns of 10: 1 + 10 + 3 + 4 * (10 + 3) + 2 * 3 = 72 characters hold four of them.
    assert _groups([3, 4, 10, 10, 10, 10, 10], 2, 72) == [[2, 3, 4], [5, 6]]
    assert _groups([3, 4, 10, 10, 10, 10], 2, 60) == [[2, 3], [4, 5]]  # three fit, and would leave one alone
    assert _groups([3, 10], 1, 200) == [[1]]


def test_spare_width_goes_to_the_columns_that_wrap_most():
    # Of 5 + 18 + 1 + 2 * 3 = 30 characters, 6 are left: 8 lack here and 2 there.
    assert _widths([_Need(2, 4), _Need(10, 18)], 25) == [2, 16]
    assert _widths([_Need(2, 4), _Need(10, 18)], 27) == [3, 17]
    assert _widths([_Need(2, 4), _Need(10, 18)], 99) == [4, 18]
