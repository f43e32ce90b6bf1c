"""Outputs of commands: checked before the work, never an input, and overwritten only with --force."""

import os
import sys
from dataclasses import fields
from pathlib import Path

import pytest

from turtlebot_gym_agents.commands.cli import commands, main
from turtlebot_gym_agents.outputs import FIGURE, FOLDER, JSON, _kinds_of, require_outputs

COMMANDS = commands()
"""Those of the installed satellites too."""
READ = {"entries", "config", "against", "check", "file", "files", "log", "model", "drive", "map", "measured"}
"""Options that name files to be read."""
NEEDED = {name: ["drive.csv"] for name in ("replay", "calibrate", "export", "study")}
NEEDED["card"] = ["ppo-nav"]
WRITTEN = [(name, option) for name, command in COMMANDS.items() for option in _kinds_of(command)]
FILES = [(name, option) for name, option in WRITTEN if not _kinds_of(COMMANDS[name])[option].folder]


def flag_of(option):
    return "--" + option.replace("_", "-")


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "drive.csv").write_text("t,vx,gyro,px,py,theta\n0,0,0,0,0,0\n")
    return tmp_path


@pytest.mark.parametrize("name", COMMANDS)
def test_each_option_that_names_a_path_is_known_as_an_input_or_an_output(name):
    command = COMMANDS[name]
    paths = {item.name for item in fields(command) if any(word in str(item.type) for word in ("Path", "File"))}
    assert paths - READ == set(_kinds_of(command))


@pytest.fixture
def untouched(monkeypatch):
    """Fail if a command begins its work."""

    def run(self):
        raise AssertionError("it has begun")

    for command in COMMANDS.values():
        monkeypatch.setattr(command, "run", run)


def refused(name, option, value, capsys, *more):
    assert main([name, *NEEDED.get(name, []), flag_of(option), str(value), *more]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"turtlebot-gym: {flag_of(option)} {value}"), line
    return line


@pytest.mark.sample(7)
@pytest.mark.parametrize(("name", "option"), WRITTEN)
def test_an_output_that_cannot_be_written_is_refused_before_the_work(name, option, untouched, capsys, folder):
    kind = _kinds_of(COMMANDS[name])[option]
    (ending,) = kind.endings[:1] or ("",)
    if kind.folder:
        assert "a folder is needed" in refused(name, option, "drive.csv", capsys)
        assert "it cannot be written" in refused(name, option, "drive.csv/inside", capsys)
        return
    for occupied in ("folder", f"folder{ending}"):
        (folder / occupied).mkdir()
        assert "a file is needed" in refused(name, option, occupied, capsys)
    assert "its name must end with" in refused(name, option, "a.nothing", capsys)
    assert "it cannot be written" in refused(name, option, f"drive.csv/a{ending}", capsys)
    assert "it cannot be written" in refused(name, option, f"/proc/none/a{ending}", capsys)
    assert sorted(path.name for path in folder.iterdir() if path.name != "runs") == ["drive.csv", "folder", f"folder{ending}"]


@pytest.mark.parametrize(("name", "option"), FILES)
def test_a_result_is_overwritten_only_with_force(name, option, untouched, capsys, folder):
    kind = _kinds_of(COMMANDS[name])[option]
    path = folder / f"result{kind.endings[0]}"
    path.write_text("dear")
    if kind.resumed:
        with pytest.raises(AssertionError, match="begun"):
            main([name, flag_of(option), str(path)])
    else:
        assert "overwrite it with --force" in refused(name, option, path, capsys)
    with pytest.raises(AssertionError, match="begun"):
        main([name, *NEEDED.get(name, []), flag_of(option), str(path), "--force"])
    assert path.read_text() == "dear"  # until there is something to put in its place


@pytest.mark.parametrize("link", [os.symlink, os.link, None], ids=["symbolic", "hard", "itself"])
def test_neither_an_input_nor_another_output_is_overwritten_even_with_force(link, untouched, capsys, folder):
    (folder / "mine.json").write_text("{}")
    target = "mine.json"
    if link:
        target = "other.json"
        link("mine.json", target)
    for words, message in (
        (f"evaluate --policy bearing mine.json+safety --json {target}", f"--json {target}: it is an input"),
    ):
        assert main([*words.split(), "--force"]) == 2, words
        assert message in capsys.readouterr().err, words
    assert sys.path.count(str(Path.cwd())) <= 1  # the path of modules does not grow


def test_a_link_to_nothing_stays_one_and_devices_and_empty_files_are_written(folder):
    os.symlink("later.json", "link.json")
    (folder / "made.json").touch()  # as mktemp does
    for path in ("link.json", "/dev/null", "made.json"):
        require_outputs([("--json", Path(path), JSON)])
    assert os.readlink("link.json") == "later.json"
    assert not (folder / "later.json").exists()


def test_missing_folders_of_files_are_made_and_existing_ones_kept(folder):
    require_outputs([("--json", Path("a/b/c.json"), JSON), ("--out", Path("d"), FOLDER), ("--plot", Path("e.svg"), FIGURE)])
    assert (folder / "a" / "b").is_dir()
    assert not list((folder / "a" / "b").iterdir())
    assert not (folder / "d").exists()  # the work makes it
    (folder / "d").mkdir()
    (folder / "d" / "kept").touch()
    require_outputs([("--out", Path("d"), FOLDER)])
    assert [path.name for path in (folder / "d").iterdir()] == ["kept"]


def test_a_run_is_not_trained_over(folder, capsys):
    (folder / "runs" / "seed-1").mkdir(parents=True)
    (folder / "runs" / "seed-1" / "config.json").touch()
    assert main(["train", "--out", "runs", "--seeds", "2"]) == 2
    assert "seed-1 holds a run already" in capsys.readouterr().err
    assert not (folder / "runs" / "seed-0").exists()
