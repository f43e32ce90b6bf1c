"""Two clones in pairs: their turns alternate, the median counts, and each clone is the one that was asked for."""

import json
import sys
from pathlib import Path

import pytest

from harness import measure, pairs, peer
from harness.peers import Entry
from harness.turns import Turn
from turtlebot_gym_agents.commands.cli import main

ROOT = Path(__file__).parents[2]


class Clone:
    """A process whose turns take a given time per call; it notes who had a turn."""

    def __init__(self, name, seconds, noted):
        self.name, self.seconds, self.noted = name, iter(seconds), noted

    def turn(self, calls):
        self.noted.append((self.name, calls))
        return Turn(9.9, next(self.seconds) * calls)

    def stop(self):
        self.noted.append((self.name, "stopped"))


@pytest.fixture
def clones(monkeypatch, tmp_path):
    """Replace the processes of both clones; the noted turns."""
    noted = []

    def start(folder, entry, log):
        # this clone takes 1 s per call, the other 2, 1, 0.5, 1 and 1 s
        return Clone("here", [1.0] * 5, noted) if folder == pairs.HERE else Clone("there", [2.0, 1.0, 0.5, 1.0, 1.0], noted)

    monkeypatch.setattr(pairs, "start", start)
    monkeypatch.setattr(pairs, "calls_for", lambda run, seconds: 4)
    return noted


def test_clones_take_turns_in_alternating_order_and_the_median_counts(clones, tmp_path):
    done = []
    rows = pairs.compare(tmp_path, ["scalar"], rounds=5, seconds=0.1, progress=done.append)
    assert rows == {"scalar": pairs.Pair(1.0, (0.75, 1.5), 5)}
    order = [name for name, calls in clones if calls == 4]
    assert order == ["here", "there", "there", "here"] * 2 + ["here", "there"]
    assert [name for name, calls in clones if calls == "stopped"] == ["there", "here"]
    assert done == [1, 2, 3, 4, 5]


@pytest.mark.parametrize(("ratio", "status"), [(0.96, 1), (0.98, 0)])
def test_a_loss_is_measured_twice_and_ends_in_status_1(ratio, status, monkeypatch, tmp_path, capsys):
    asked = []

    def compare(other, names=("scalar", "rooms"), *, rounds, **options):
        asked.append((tuple(names), rounds))
        return {name: pairs.Pair(ratio if name == "scalar" else 1.0, (0.9, 1.1), rounds) for name in names}

    monkeypatch.setattr(measure.pairs, "compare", compare)
    arguments = ["benchmark", "--against", str(tmp_path), "--rounds", "3", "--json", str(tmp_path / "pairs.json")]
    if status:
        with pytest.raises(SystemExit, match="1"):
            main(arguments)
        assert "1 of 2 have lost more than 3%." in capsys.readouterr().err
        assert asked == [(("scalar", "rooms"), 3), (("scalar",), 6)]
    else:
        assert main(arguments) == 0
        assert asked == [(("scalar", "rooms"), 3)]
    assert json.loads((tmp_path / "pairs.json").read_text())["pairs"]["scalar"]["ratio"] == ratio


def test_a_process_that_imports_another_clone_is_refused(monkeypatch, tmp_path):
    stand_in = f'print("ready {{\\"file\\": \\"{ROOT}/turtlebot_gym/__init__.py\\"}}", flush=True); input()'
    monkeypatch.setattr(peer, "__file__", str(tmp_path / "stand_in.py"))
    (tmp_path / "stand_in.py").write_text(stand_in)
    entry = Entry(pairs.NAV, 1, "scalar")
    pairs.start(ROOT, entry, tmp_path / "log").stop()
    with pytest.raises(ValueError, match="must be a clone of the repository; its process imports"):
        pairs.start(tmp_path, entry, tmp_path / "log")


@pytest.mark.parametrize(("form", "size"), [("scalar", 1), ("vector", 2), ("rough", 2)])
def test_a_clone_steps_its_environments(form, size):
    step = peer.clone_calls(pairs.NAV, size, form)
    for k in range(3):
        step(k)
    assert Path(peer.versions_of(())["file"]) == Path(sys.modules["turtlebot_gym"].__file__)
