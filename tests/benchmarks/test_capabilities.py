"""The list of capabilities: each is a line of the CHANGELOG, and a run tells what failed and what was left out."""

import re

import pytest

import capabilities
from capabilities import Config

CHANGELOG = (capabilities.ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_every_entry_is_a_line_of_the_changelog_and_every_line_has_one():
    listed = capabilities.read()
    for says in (*listed["pages"], *(row["says"] for row in listed["capability"])):
        assert f"\n* {says}" in CHANGELOG, says
    assert all(("run" in row) != ("python" in row) for row in listed["capability"])
    assert capabilities.unlisted(CHANGELOG, listed) == []


@pytest.mark.parametrize("table", ["capabilities.toml", "mutants.toml"])
def test_the_tests_that_a_table_names_are_there(table):
    names = re.findall(r"tests/[\w/]+\.py", (capabilities.HERE / table).read_text(encoding="utf-8"))
    assert names
    assert [name for name in names if not (capabilities.ROOT / name).is_file()] == []


def test_lines_without_an_entry_are_listed():
    listed = {"pages": ["A page"], "capability": [{"says": "A command"}]}
    changelog = "# Changes\n\n* A page is new.\n* A command\n  is new.\n* A flag\n  is new.\n\n## 0.1\n"
    assert capabilities.unlisted(changelog, listed) == ["A flag is new."]


def test_a_run_has_the_last_line_and_the_status(tmp_path):
    config = Config(data=tmp_path / "none", seconds=20.0)
    shown = [
        capabilities.show({"says": "a", **row}, tmp_path, config)
        for row in (
            {"run": "echo one > file; echo; echo '└──┘'"},
            {"run": "cat file; false"},
            {"python": "print(2 + 3)\nprint('└──┘')"},
            {"run": "true", "needs": "data"},
            {"run": "true", "needs": "no-such-program"},
        )
    ]
    assert [(row.last, row.status) for row in shown] == [
        ("", 0), ("one", 1), ("5", 0), ("left out: data is missing", None), ("left out: no-such-program is missing", None),
    ]  # fmt: skip
    assert capabilities.table(shown).count("\n") == 2 + len(shown)


def test_a_command_that_hangs_is_ended(tmp_path):
    shown = capabilities.show({"says": "a", "run": "sleep 60"}, tmp_path, Config(seconds=0.5))
    assert (shown.status, shown.last) == (124, "longer than 0.5 s")
