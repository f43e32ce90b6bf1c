"""The guard of speed: which ratio counts, how much of it may be lost, and what a busy machine cannot tell."""

import json

import pytest

from harness import check
from harness.turns import Row


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
        "scalar": "CPU seconds", "all threads": "wall time", "one thread": "CPU seconds",
    }  # fmt: skip
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
    here = {"cpu": "A", "cores": 2, "numba": "1"}
    assert check.elsewhere(here, here) is None
    assert check.elsewhere(here, here | {"load_before": 3.0}) is None
    assert "cores 2 there and 8 here" in str(check.elsewhere(here, here | {"cores": 8}))
