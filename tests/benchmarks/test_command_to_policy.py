"""The benchmark from command to policy: its arithmetic, and that it leaves no process behind."""

from __future__ import annotations

import importlib.util
import os
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")
FILE = Path(__file__).parents[2] / "benchmarks" / "command_to_policy.py"


@pytest.fixture(scope="module")
def module():
    spec = importlib.util.spec_from_file_location("command_to_policy", FILE)
    loaded = sys.modules["command_to_policy"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


def test_ratios_are_medians_of_the_rounds_ratios(module):
    cost = module.Cost
    rounds = [
        {"a": cost(4.0, 9.0), "b": cost(2.0, 3.0)},
        {"a": cost(3.0, 8.0), "b": cost(3.0, 1.0)},
        {"a": cost(9.0, 1.0), "b": cost(1.0, 1.0)},
    ]
    assert module.ratio(rounds, "a", "b", "wall") == 2.0  # of 2, 1 and 9; the ratio of the medians would be 2.0 too ...
    assert module.ratio(rounds, "a", "b", "cpu") == 3.0  # ... but here it would be 8


def test_the_stopwatch_counts_every_second_once(module, monkeypatch):
    clock = iter([0.0, 1.0, 3.0, 4.0, 9.0, 10.0])
    monkeypatch.setattr(module, "_now", lambda: (now := next(clock), 2.0 * now))
    watch = module.Stopwatch()
    with watch.time("outer"):
        assert watch.timed("inner", lambda x: x + 1)(1) == 2
        with watch.time("inner"):
            pass
    assert watch.taken == {"inner": [7.0, 14.0], "outer": [3.0, 6.0]}  # 10 in all


def test_busy_processes_end_with_their_block(module):
    def children():
        return [one for one in Path("/proc").iterdir() if one.name.isdigit() and _is_ours(one)]

    with module.busy(2):
        deadline = time.monotonic() + 30.0
        while len(children()) < 2 and time.monotonic() < deadline:
            time.sleep(0.01)
        assert len(children()) == 2
    assert children() == []


def _is_ours(process: Path) -> bool:
    """Return whether a process is a busy one that this test has started."""
    try:
        parent = int(process.joinpath("stat").read_text().rpartition(")")[2].split()[1])
        return parent == os.getpid() and b"while True: pass" in process.joinpath("cmdline").read_bytes()
    except (OSError, IndexError, ValueError):
        return False


def test_the_bare_learning_and_the_command_are_the_same_training(module, tmp_path):
    """Both leave the same weights: what is compared is the same work."""
    import torch
    from stable_baselines3 import PPO

    from turtlebot_gym_agents.training import train as training

    made = []
    config = module.Config(steps=1)
    make_model, training.make_model = (
        training.make_model,
        lambda *args, **kwargs: made.append(make_model(*args, **kwargs)) or made[-1],
    )
    try:
        cost = module.bare(config)
    finally:
        training.make_model = make_model
    assert cost.wall > 0.0
    assert cost.cpu > 0.0
    training.train(training.TrainingConfig(steps=1, episodes=4, evaluations=1), tmp_path / "run", progress=False)
    bare, whole = (
        model.policy.state_dict() for model in (made[0], PPO.load(tmp_path / "run" / "checkpoint.zip", device="cpu"))
    )
    assert bare.keys() == whole.keys()
    assert all(torch.equal(bare[name], whole[name]) for name in bare)
