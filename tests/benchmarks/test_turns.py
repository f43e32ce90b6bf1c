"""The benchmark: rates and ratios worked out by hand, turns in their order, threads, busy processes; no test is timed."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import nullcontext
from pathlib import Path

import llvmlite
import pytest

from harness import environments, machine, report
from harness.environments import contenders, one_thread
from harness.turns import Contender, Turn, calls_for, rows_of, take_turns, timed
from turtlebot_gym.compiled.threads import Threads
from turtlebot_gym_agents.commands.cli import main
from turtlebot_gym_agents.provenance import plain

BENCHMARKS = str(Path(machine.__file__).parents[1])


def made_up(base="slow", *, size=1, by="turtlebot_gym", run=lambda calls: Turn(1.0, 1.0), **options):
    return Contender(run=run, size=size, base=base, by=by, **options)


def test_rates_and_ratios_are_medians_over_the_rounds():
    """Ten calls of 8 environments are 80 steps; the base makes 100 calls of one step."""
    both = {"slow": made_up(), "fast": made_up(size=8, threads=1)}
    turns = {
        "slow": [Turn(1.0, 2.0), Turn(2.0, 2.0), Turn(10.0, 2.0)],  # 100, 50, 10 steps/s; 50 to a CPU second
        "fast": [Turn(0.5, 0.8), Turn(0.2, 1.6), Turn(2.0, 0.4)],  # 160, 400, 40 steps/s; 100, 50, 200
    }
    rows = rows_of(both, {"slow": 100, "fast": 10}, turns)
    assert rows["slow"].steps_per_second == pytest.approx(50.0)
    assert (rows["slow"].ratio, rows["slow"].cpu_ratio, rows["slow"].ratio_range) == (1.0, 1.0, (1.0, 1.0))
    fast = rows["fast"]
    assert (fast.by, fast.size, fast.threads, fast.base) == ("turtlebot_gym", 8, 1, "slow")
    assert (fast.steps_per_second, fast.steps_per_cpu_second) == pytest.approx((160.0, 100.0))
    assert (fast.ratio, fast.cpu_ratio) == pytest.approx((4.0, 2.0))  # of 1.6, 8 and 4; of 2, 1 and 4
    assert fast.ratio_range == pytest.approx((1.6, 8.0))
    busy = {name: [first, Turn(7.0 * slow.wall, slow.cpu), last] for name, (first, slow, last) in turns.items()}
    beside = rows_of(both, {"slow": 100, "fast": 10}, busy)["fast"]  # a disturbance of a whole round moves no ratio
    assert (beside.ratio, beside.cpu_ratio, *beside.ratio_range) == pytest.approx((4.0, 2.0, 1.6, 8.0))


def test_contenders_take_turns_back_and_forth():
    order, done = [], []

    def run_of(name):
        def run(calls):
            order.append((name, calls))
            return Turn(0.01 * calls, 0.02 * calls)

        return run

    both = {name: made_up("a", run=run_of(name)) for name in "abc"}
    sat = take_turns(both, rounds=3, seconds=0.16, progress=done.append)
    turns = [name for name, calls in order if calls == 16]  # 16 calls of 0.01 s
    assert turns == [*"abc", *"cba", *"abc"]
    assert done == [*range(1, 10)]
    assert sat.environments["b"].steps_per_second == pytest.approx(100.0)
    assert sat.environments["b"].steps_per_cpu_second == pytest.approx(50.0)
    assert sat.used_by_others is None or 0.0 <= sat.used_by_others <= machine.cores()


@pytest.mark.parametrize(("of_one", "calls"), [(0.001, 200), (0.03, 7), (5.0, 1)])
def test_a_turn_takes_about_as_long_as_told(of_one, calls):
    made = []
    number = calls_for(lambda n: made.append(n) or Turn(of_one * n, 0.0), 0.2)
    assert number == calls
    assert made[0] == 1  # compiles, and does not count


@pytest.fixture(scope="module")
def few():
    return contenders((8, 16))


@pytest.mark.nightly
def test_ours_are_compared_with_cartpole_of_the_same_size(few):
    bases = [name for name, contender in few.items() if contender.base == name]
    assert bases == ["scalar, CartPole-v1", "vector of 8, CartPole-v1", "vector of 16, CartPole-v1"]
    for name, contender in few.items():
        assert few[contender.base].size == contender.size, name
        assert contender.by == ("gymnasium" if contender.base == name else "turtlebot_gym")
        assert (contender.threads == 1) == name.endswith("one thread")
    assert {name.partition(", ")[2] for name in few if name.startswith("vector of 8")} == {
        "CartPole-v1",
        *(
            f"{env}{threads}"
            for threads in ("", ", one thread")
            for env in (
                "TurtleBotNav-v0",
                "TurtleBotSquare-v0",
                *(f"TurtleBotNav-v0, {more}" for more in ("noise rough", "info full", "randomized", "fix late")),
            )
        ),
    }
    key = {name for name, contender in few.items() if contender.key}
    assert {few[name].base for name in key} <= key
    assert "vector of 16, TurtleBotNav-v0, one thread" in key


def broken():
    raise RuntimeError("it broke")


def test_calls_are_made_and_counted_with_one_thread_where_asked_and_others_come_back():
    before, made = Threads.count(), []
    turn = timed(lambda k: made.append((k, Threads.count())), one_thread)(3)
    assert made == [(0, 1), (1, 1), (2, 1)]
    assert turn.wall > 0.0 <= turn.cpu
    assert Threads.count() == before
    with pytest.raises(RuntimeError, match="it broke"):
        timed(lambda k: broken(), one_thread)(1)
    assert Threads.count() == before


def test_the_threads_of_a_contender_are_limited_while_it_runs(monkeypatch):
    seen = []

    class Envs:
        action_space = type("Space", (), {"seed": lambda self, seed: None, "sample": lambda self: 0})()

        def reset(self, seed):
            pass

        def step(self, actions):
            seen.append(Threads.count())

    monkeypatch.setattr(environments.gym, "make_vec", lambda *given, **options: Envs())
    before = Threads.count()
    for threads in (None, 1):
        environments._vector("made up", 4, by="turtlebot_gym", threads=threads).run(2)
    assert seen == [before, before, 1, 1]


def test_the_machine_is_described():
    described = machine.machine()
    assert json.loads(json.dumps(described)) == described
    assert described["cores"] == machine.cores() > 0
    assert described["llvmlite"] == llvmlite.__version__
    if sys.platform == "linux":
        assert described["cpu"]


@pytest.mark.parametrize(
    ("idle", "own", "others"),
    [((10.0, 17.0), 10.0, 0.3), ((10.0, 10.0), 5.0, 1.5), ((10.0, 25.0), 20.0, 0.0), ((None, None), 1.0, None)],
)
def test_what_others_use_is_what_is_neither_idle_nor_ours(monkeypatch, idle, own, others):
    """Two cores for ten seconds are 20 s: 7 s idle and 10 s of ours leave 3 s, 0.3 cores."""
    clock, idle = iter([100.0, 110.0]), iter(idle)
    monkeypatch.setattr(machine, "cores", lambda: 2)
    monkeypatch.setattr(machine, "_idle_seconds", lambda: next(idle))
    monkeypatch.setattr(machine.time, "perf_counter", lambda: next(clock))
    assert machine.Watch().used_by_others(own) == (None if others is None else pytest.approx(others))


def alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_busy_processes_run_and_are_ended(monkeypatch):
    started, popen = [], subprocess.Popen
    monkeypatch.setattr(machine.subprocess, "Popen", lambda *given: started.append(popen(*given)) or started[-1])
    with machine.busy(2):
        assert len(started) == 2
        assert all(process.poll() is None for process in started)
    assert [process.returncode for process in started] == [-signal.SIGKILL] * 2
    with pytest.raises(RuntimeError, match="it broke"), machine.busy(1):
        broken()
    assert [process.returncode for process in started] == [-signal.SIGKILL] * 3


def test_busy_processes_end_with_a_benchmark_that_was_killed():
    script = (
        f"import os, subprocess, sys, time\nsys.path.append({BENCHMARKS!r})\nfrom harness import machine\n"
        "child = subprocess.Popen([sys.executable, '-I', '-c', machine._BUSY, str(os.getpid())])\n"
        "print(child.pid, flush=True)\ntime.sleep(600)"
    )
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) as parent:
        child = int(parent.stdout.readline())
        assert alive(child)
        parent.kill()
    for _ in range(600):  # a minute, on a busy machine
        if not alive(child):
            return
        time.sleep(0.1)
    os.kill(child, signal.SIGKILL)
    pytest.fail("a busy process has outlived its parent")


def a_row(name, base, rate, cpu_rate, ratio, *, by="turtlebot_gym", size=4096, threads=None):
    row = {"by": by, "size": size, "threads": threads, "base": base, "steps_per_second": rate}
    return {name: row | {"steps_per_cpu_second": cpu_rate, "ratio": ratio, "cpu_ratio": 0.25, "ratio_range": [1.5, 2.5]}}


def a_result(**more):
    base = "vector of 4096, CartPole-v1"
    rows = {
        **a_row("scalar, CartPole-v1", "scalar, CartPole-v1", 150_000.0, 151_000.0, 1.0, by="gymnasium", size=1),
        **a_row("scalar, TurtleBotNav-v0", "scalar, CartPole-v1", 180_000.0, 181_000.0, 1.2, size=1),
        **a_row(base, base, 1e7, 1e7, 1.0, by="gymnasium"),
        **a_row("vector of 4096, TurtleBotNav-v0", base, 2.08e7, 1.1e7, 2.08),
        **a_row("vector of 4096, TurtleBotNav-v0, one thread", base, 1.2e7, 1.2e7, 1.2, threads=1),
        **a_row("vector of 1024, EnvPool's CartPole-v1", base, 4e5, 5e5, 0.04, by="envpool", size=1024),
    }
    described = {"cores": 2, "cpu": "A processor", "llvm_cpu": "some", "load_before": 0.5}
    return {"machine": described, "used_by_others": 0.25, "environments": rows, **more}


def busy_part(result):
    names = [name for name, row in result["environments"].items() if row["size"] in (1, 4096)]
    return {"processes": 4, "environments": {name: result["environments"][name] for name in names}}


def test_tables_have_the_busy_machine_where_it_was_measured():
    result = a_result()
    assert len(report.tables(result)) == 1
    environment, beside = report.tables(result | {"busy": busy_part(result)})
    assert (environment.row_count, beside.row_count) == (6, 5)
    assert "other programs used 0.2 cores" in str(environment.title)


def test_the_command_writes_what_it_measured_and_guards_it(tmp_path, capsys):
    path, before = tmp_path / "out" / "speed.json", tmp_path / "before.json"
    quick = ["--rounds", "1", "--seconds", "0.001"]
    options = ["--num-envs", "16", *quick, "--busy", "1"]
    assert main(["benchmark", *options, "--json", str(path)]) == 0
    printed = capsys.readouterr()
    assert "beside 1 busy process " in printed.out
    assert not printed.err
    content = json.loads(path.read_text())
    assert content == plain(content)
    assert content["config"].items() >= {"num_envs": [16], "rounds": 1, "busy": 1}.items()
    assert content["machine"]["cores"] == machine.cores()
    assert content["busy"]["environments"].keys() < content["environments"].keys()
    ours = [row for row in content["environments"].values() if row["by"] != "gymnasium"]
    for change in (1e-6, 1e6):
        for row in content["environments"].values():
            row["ratio"], row["cpu_ratio"] = change, change
        before.write_text(json.dumps(content))
        with nullcontext() if change < 1.0 else pytest.raises(SystemExit, match="1"):
            assert main(["benchmark", "--check", str(before), *quick]) == 0
        printed = capsys.readouterr()
        assert len(printed.out.splitlines()) == len(ours)
        assert ("LOST      scalar, TurtleBotNav-v0: " in printed.out) == (change > 1.0)
        assert ("ratios have lost more than 25%" in printed.err) == (change > 1.0)
