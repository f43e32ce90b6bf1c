"""The guard of speed: two clones in pairs, whose turns alternate; which ratio counts, and how much of it may be lost."""

import io
import json
import sys
from pathlib import Path

import numpy as np
import pytest

from harness import check, clone, measure, pairs
from harness.pairs import Entry, Process
from harness.turns import Row, Turn
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


STAND_IN = """
import json, sys
print("a library says hello")
print("ready", json.dumps({"python": "3"}), flush=True)
for line in sys.stdin:
    print("noise\\nturn", json.dumps([int(line) * 0.5, int(line) * 2.0]), flush=True)
    if int(line) > 99:
        sys.exit("it broke")
"""


def process(tmp_path, program=STAND_IN):
    return Process([sys.executable, "-I", "-c", program], tmp_path / "log.txt")


def test_a_process_answers_each_turn_and_one_that_ends_says_why(tmp_path):
    stand_in = process(tmp_path)
    assert stand_in.ready == {"python": "3"}
    assert [stand_in.turn(calls) for calls in (3, 100)] == [(1.5, 6.0), (50.0, 200.0)]
    with pytest.raises(ChildProcessError, match="ended with status 1: it broke"):
        stand_in.turn(1)
    stand_in.stop()
    with pytest.raises(ChildProcessError, match="ended with status 1: ModuleNotFoundError: No module named 'nothing_such'"):
        process(tmp_path, "import nothing_such")


def test_the_program_makes_as_many_calls_as_it_is_asked_for(monkeypatch, capsys):
    made = []
    monkeypatch.setattr(clone, "clone_calls", lambda *given: made.append(given) or made.append)
    monkeypatch.setattr(sys, "stdin", io.StringIO("3\n1\n"))
    clone.main(pairs.NAV, "8", "vector")
    assert made == [(pairs.NAV, 8, "vector"), 0, 0, 1, 2, 0]
    ready, *turns = capsys.readouterr().out.splitlines()
    assert json.loads(ready.removeprefix("ready"))["numpy"] == np.__version__
    assert [min(json.loads(turn.removeprefix("turn"))) >= 0.0 for turn in turns] == [True, True]


def test_a_process_that_imports_another_clone_is_refused(monkeypatch, tmp_path):
    stand_in = f'print("ready {{\\"file\\": \\"{ROOT}/turtlebot_gym/__init__.py\\"}}", flush=True); input()'
    monkeypatch.setattr(clone, "__file__", str(tmp_path / "stand_in.py"))
    (tmp_path / "stand_in.py").write_text(stand_in)
    entry = Entry(pairs.NAV, 1, "scalar")
    pairs.start(ROOT, entry, tmp_path / "log").stop()
    with pytest.raises(ValueError, match="must be a clone of the repository; its process imports"):
        pairs.start(tmp_path, entry, tmp_path / "log")


@pytest.mark.parametrize(("form", "size"), [("scalar", 1), ("vector", 2), ("rough", 2)])
def test_a_clone_steps_its_environments(form, size):
    step = clone.clone_calls(pairs.NAV, size, form)
    for k in range(3):
        step(k)
    assert Path(clone.versions()["file"]) == Path(sys.modules["turtlebot_gym"].__file__)


def row(ratio, cpu_ratio, *, by="turtlebot_gym", size=4096, threads=None):
    return Row(by, size, threads, "CartPole", 1e6, 1e6, ratio, cpu_ratio, (ratio, ratio))


BEFORE = {
    "CartPole": row(1.0, 1.0, by="gymnasium")._asdict(),
    "scalar": row(9.0, 1.2, size=1)._asdict(),
    "all threads": row(2.0, 9.0)._asdict(),
    "one thread": row(9.0, 1.0, threads=1)._asdict(),
    "peer": row(5.0, 5.0, by="gymnax")._asdict(),
}


def judged(*, quiet=True, tolerance=0.25, **now):
    rows = {"scalar": row(0.1, 1.2, size=1), "all threads": row(2.0, 0.1), "one thread": row(0.1, 1.0, threads=1)}
    rows |= {name.replace("_", " "): measured for name, measured in now.items()}
    return {verdict.name: verdict for verdict in check.judge(BEFORE, rows, quiet=quiet, tolerance=tolerance)}


def test_one_thread_is_judged_by_cpu_seconds_and_several_by_wall_time():
    """The other ratio of each row has fallen to nothing."""
    verdicts = judged()
    assert {name: verdict.clock for name, verdict in verdicts.items()} == {
        "scalar": "CPU seconds",
        "all threads": "wall time",
        "one thread": "CPU seconds",
    }
    assert {verdict.state for verdict in verdicts.values()} == {"ok"}


@pytest.mark.parametrize(
    ("now", "tolerance", "state"),
    [
        *((now, 0.25, "ok") for now in (1.51, 1.5, 8.0)),
        *((now, 0.25, "LOST") for now in (1.49, 0.0)),
        *((1.8, tolerance, state) for tolerance, state in ((0.0, "LOST"), (0.09, "LOST"), (0.11, "ok"), (0.9, "ok"))),
    ],
)
def test_a_quarter_or_the_given_share_may_be_lost(now, tolerance, state):
    """Of the 2 times that it was."""
    assert judged(all_threads=row(now, 9.0), tolerance=tolerance)["all threads"].state == state


def test_a_busy_machine_judges_single_threads_alone():
    verdicts = judged(quiet=False, all_threads=row(0.1, 0.1), scalar=row(9.0, 0.1, size=1))
    assert verdicts["all threads"].state == "left out"
    assert verdicts["scalar"].state == "LOST"
    assert verdicts["one thread"].state == "ok"
    assert check.lost(verdicts.values()) == ["scalar"]


def test_a_row_that_is_not_measured_any_more_is_lost():
    rows = {"all threads": row(2.0, 9.0)}
    assert check.lost(check.judge(BEFORE, rows, quiet=True)) == ["scalar", "one thread"]


def test_each_verdict_is_one_line():
    verdicts = judged(scalar=row(0.1, 0.6, size=1))
    assert str(verdicts["scalar"]) == "LOST      scalar: 0.60 times CartPole, 1.20 before (-50 %, CPU seconds)"
    assert str(verdicts["all threads"]) == "ok        all threads: 2.00 times CartPole, 2.00 before (+0 %, wall time)"
    assert str(judged(quiet=False)["all threads"]) == "left out  all threads: other programs keep the cores busy"
    gone = check.judge(BEFORE, {}, quiet=True)[0]
    assert str(gone) == "LOST      scalar: is no longer measured"


@pytest.mark.parametrize(
    ("used", "cores", "expected"), [(0.0, 2, True), (0.15, 2, True), (0.3, 2, False), (0.3, 64, True), (None, 2, True)]
)
def test_a_tenth_of_the_cores_may_be_used_by_others(used, cores, expected):
    assert check.free(used, cores) is expected


@pytest.mark.parametrize(
    "text", ["", "{}", "[]", '{"environments": 3}', '{"environments": {"a": 3}}', '{"environments": {"a": {"ratio": 1.0}}}']
)
def test_a_file_of_the_benchmark_is_read_and_another_one_is_refused(tmp_path, text):
    path = tmp_path / "a.json"
    path.write_text(json.dumps({"environments": BEFORE}))
    assert check.read(path)["environments"]["scalar"]["cpu_ratio"] == 1.2
    path.write_text(text)
    with pytest.raises(ValueError, match=r"a\.json must be a file that `turtlebot-gym benchmark --json` has written"):
        check.read(path)
    with pytest.raises(ValueError, match="must hold this package's ratios"):
        check.judge({"peer": BEFORE["peer"]}, {}, quiet=True)


def test_another_machine_is_named():
    here = {"cpu": "A", "cores": 2, "llvmlite": "1"}
    assert check.elsewhere(here, here) is None
    assert check.elsewhere(here, here | {"load_before": 3.0}) is None
    assert "cores 2 there and 8 here" in str(check.elsewhere(here, here | {"cores": 8}))
