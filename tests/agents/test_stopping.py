"""Trainings that stop early, when an evaluation reaches a target or after a time, and the CPU seconds of trainings."""

import re
import time
from dataclasses import replace

import pytest

from turtlebot_gym_agents import train as train_seeds
from turtlebot_gym_agents.training import callbacks
from turtlebot_gym_agents.training.config import TrainingConfig
from turtlebot_gym_agents.training.judging import Judged
from turtlebot_gym_agents.training.timing import Stopwatch, _InTime
from turtlebot_gym_agents.training.train import train

SMALL = {"n_envs": 64, "n_timesteps": 8192, "policy": "MlpPolicy", "policy_kwargs": {"net_arch": [8]}}
SMALL |= {"n_steps": 16, "batch_size": 1024, "n_epochs": 1, "learning_rate": "lin_0.001"}
small = TrainingConfig(config=SMALL, episodes=8, evaluations=4)


def test_it_stops_at_the_first_evaluation_that_reaches_the_target_and_stays_stopped(tmp_path):
    folder = tmp_path / "run"
    config = replace(small, until="return=-1e6")
    first = train(config, folder, progress=False)
    assert (first.stopped, len(first.history)) == ("until", 1)
    assert first.history[0]["steps"] == 2048 <= first.steps < 8192
    assert (folder / "policy.onnx").is_file()
    again = train(config, folder, resume=True, progress=False)
    assert (again.stopped, again.steps, again.best) == ("until", first.steps, first.best)
    more = train(replace(small, until="success=1.0"), folder, resume=True, progress=False)
    assert (more.stopped, more.steps >= 8192) == (None, True)


def test_it_stops_only_if_all_episodes_agree(tmp_path, monkeypatch):
    """The first 2 of 8 episodes reach every target, all of them none before the end."""
    config = replace(small, until="success=1.0", steps=4096, evaluations=2)
    monkeypatch.setattr(callbacks, "INTERIM", 2)
    counts = []

    def figures(judged):
        counts.append(len(judged.success))
        return {"success": float(len(judged.success) == 2), "return": 1.0, "steps_to_end": 1.0}

    monkeypatch.setattr(Judged, "figures", figures)
    result = train(config, tmp_path / "run", progress=False)
    assert (result.stopped, counts[:2]) == (None, [2, 8])
    assert result.steps == 4096


def test_the_verdict_counts_the_trainings_that_reach_it(tmp_path):
    config = replace(small, steps=1024, evaluations=1)
    for until, count in (("return=-1e6", 1), ("success=1", 0)):
        verdict = train_seeds(config, tmp_path / until, until=until, progress=False).verdict()
        assert verdict.endswith(f"{count} of 1 trainings reached {until} in 8 episodes.")


def test_it_stops_after_a_time_and_goes_on_with_another(tmp_path):
    config = replace(small, steps=10**9, evaluations=10**6, checkpoint_seconds=1e9, seconds=1.0)
    first = train(config, tmp_path / "run", progress=False)
    assert first.stopped == "seconds"
    assert first.history[-1]["steps"] == first.steps < 10**9
    assert (tmp_path / "run" / "policy.onnx").is_file()
    again = train(replace(config, seconds=0.5), tmp_path / "run", resume=True, progress=False)
    assert again.stopped == "seconds"
    assert again.steps > first.steps


def test_a_schedule_ends_with_the_steps_or_with_the_time_whichever_is_first():
    begun = time.monotonic()
    assert _InTime(lambda remaining: remaining, begun, 1e9)(0.25) == 0.25
    assert _InTime(lambda remaining: remaining, begun - 5.0, 10.0)(0.75) == pytest.approx(0.5, abs=0.2)
    assert _InTime(lambda remaining: remaining, begun - 5.0, 1.0)(0.75) == 0.0


@pytest.mark.parametrize("until", ["success", "success=2", "success=0", "success=x", "reward=1", "return=inf", "", 1.0])
def test_other_targets_are_refused(until):
    with pytest.raises(ValueError, match=re.escape("until must be success=SHARE up to 1, or return=VALUE")):
        TrainingConfig(until=until)


@pytest.mark.parametrize("seconds", [0.0, -1.0, float("nan")])
def test_times_out_of_range_are_refused(seconds):
    with pytest.raises(ValueError, match=r"^seconds must be "):
        TrainingConfig(seconds=seconds)


def test_a_phase_within_another_is_charged_alone():
    def work(seconds):
        end = time.process_time() + seconds
        while time.process_time() < end:
            pass

    before, watch = time.process_time(), Stopwatch()
    with watch.phase("outer"):
        work(0.05)
        with watch.phase("inner"):
            work(0.1)
    spent = watch.seconds()
    assert 0.05 <= spent["outer"] < spent["inner"]
    assert sum(spent.values()) <= time.process_time() - before + 1e-3


def test_a_result_accounts_for_its_cpu_seconds(tmp_path):
    before = time.process_time()
    cpu = train(replace(small, steps=1024, evaluations=1), tmp_path / "run", progress=False).cpu
    assert set(cpu) == {"setup", "rollouts", "updates", "evaluations", "files", "export"}
    assert 0.0 < sum(cpu.values()) <= time.process_time() - before + 1e-3
