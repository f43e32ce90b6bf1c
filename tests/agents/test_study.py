"""The studies: their verdicts follow from their numbers, published claims have their seeds, and finished work is kept."""

import json
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")

from turtlebot_gym_agents.evaluation.metrics import Interval
from turtlebot_gym_agents.provenance import plain

ROOT = Path(__file__).parents[2]
robustness, rooms_study, scenarios = map(import_module, ("robustness", "rooms_study", "scenarios"))


def test_a_verdict_needs_the_corrected_p_value():
    for p, difference, verdict in (
        (0.049, -0.1, "PPO faster"),
        (0.049, 0.1, "PPO slower"),
        (0.05, -0.1, "no difference found"),
        (1.0, 0.1, "no difference found"),
    ):
        assert robustness.verdict({"p_holm": p, "ppo": {"difference": Interval(difference, -9.0, 9.0)}}) == verdict


def test_every_published_claim_has_five_trainings_and_a_clean_commit():
    study = json.loads((ROOT / "benchmarks" / "robustness.json").read_text(encoding="utf-8"))
    assert study["comparisons"]
    assert not study["commit"].endswith("-dirty")
    for row in study["comparisons"]:
        ppo = row["ppo"]
        assert ppo["trainings"] == len(ppo["time_of_each_training"]) == study["config"]["seeds"] >= 5
        assert ppo["episodes"] == study["config"]["episodes"] >= 2000
        assert row["compared_with"] == row["baselines"][0]["policy"]
        difference = Interval(**ppo["difference"])
        assert row["verdict"] == robustness.verdict({"p_holm": row["p_holm"], "ppo": {"difference": difference}})


def test_scenarios_have_files_of_their_own():
    names = [scenarios.slug(**options) for options in robustness.SCENARIOS.values()]
    assert len(set(names)) == len(names)
    assert max(map(len, names)) < 100
    assert scenarios.slug(**robustness.SCENARIOS["Nav, no reverse, tutorial"]) == "TurtleBotNav-v0-ekf-tutorial-reverse-False"
    assert scenarios.short("46bf714aaaabbbbccccdddd-dirty") == "46bf714aaaab-dirty"
    assert scenarios.short(None) == "unknown"


@pytest.fixture
def small(tmp_path):
    return robustness.Config(seeds=2, steps=1024, episodes=12, tries=2, processes=1, out=tmp_path)


@pytest.mark.nightly
def test_a_scenario_is_trained_tuned_and_compared_once(small, tmp_path):
    name = "Square, tutorial"
    options = robustness.SCENARIOS[name]
    bundle = scenarios.trained(tmp_path, 0, small.steps, **options) / "policy.onnx"
    trained = bundle.stat().st_mtime_ns
    compared = plain(robustness.compared(small, tmp_path, name))
    assert bundle.stat().st_mtime_ns == trained
    assert compared["seeds"] == {"training": [0, 1], "evaluation": [1_000_000, 1_000_012]}
    assert [baseline["policy"] for baseline in compared["baselines"]] == ["corner", "bearing"]  # the faster one first
    assert compared["compared_with"] == scenarios.best_baseline(tmp_path, small, **options) == "corner"
    gap = compared["ppo"]["time"]["value"] - compared["baselines"][0]["time"]["value"]
    assert compared["ppo"]["difference"]["value"] == pytest.approx(gap)
    assert compared["ppo"]["success"]["value"] < 0.5  # after a thousand steps
    files = sorted(path.relative_to(tmp_path).as_posix() for path in tmp_path.glob("*/*.json"))
    assert [path for path in files if path.startswith("tuned")] == [
        "tuned/bearing-TurtleBotSquare-v0-ekf-tutorial.json",
        "tuned/corner-TurtleBotSquare-v0-ekf-tutorial.json",
    ]


def test_jobs_return_in_order_whether_they_run_here_or_in_two_processes():
    jobs = [partial(divmod, 7, number) for number in (1, 2, 3)]
    assert scenarios.run_all(jobs, "divisions", 1) == scenarios.run_all(jobs, "divisions", 2) == [(7, 0), (3, 1), (2, 1)]


def test_the_delay_by_the_safety_layer_counts_rooms_crossed_with_and_without_it():
    def driven(time, success):
        return SimpleNamespace(episodes=SimpleNamespace(time=np.array(time), success=np.array(success)))

    layered = driven([12.0, 60.0, 11.0, 15.0], [True, False, True, True])
    bare = driven([10.0, 9.0, 3.0, 11.0], [True, True, False, True])
    delay = rooms_study.later(layered, bare)
    assert delay.value == pytest.approx(3.0)  # of 2 and 4 s
    assert delay.high - delay.value == pytest.approx(12.706, abs=1e-3)  # Student's factor for two numbers, times 1 s


@pytest.mark.nightly
def test_the_study_of_rooms_drives_each_policy_and_every_training(tmp_path):
    config = rooms_study.Config(policy=("bearing",), seeds=2, steps=1024, only=("dense", "map"), episodes=12, processes=1)
    runs = [train() for train in scenarios.trainings(tmp_path, config.steps, config.seeds, env=rooms_study.ROOMS)]
    bundle = scenarios.best_of_trainings(runs) / "policy.onnx"
    rows = rooms_study.study(config, tmp_path, runs, str(bundle))
    assert len(list((tmp_path / "drives").iterdir())) == 2 * 5  # each once: bearing, vfh, two trainings, one within the layer
    kinds = ["bearing", "vfh", "ppo-rooms", "ppo-rooms+safety", "ppo, 2 trainings"]
    assert [(row["setting"], row["policy"]) for row in rows] == [(name, kind) for name in config.only for kind in kinds]
    for row in rows:
        assert row["success"].value + row["collision"].value + row["timeout"].value == pytest.approx(1.0)
    assert rows[1]["success_difference"].value == 0.0  # with itself
    assert [row["policy"] for row in rows if "later" in row] == ["ppo-rooms+safety"] * 2
    kept = replace(config, keep=True, only=("dense", "dense, truth, noise rough"))
    again = rooms_study.study(kept, tmp_path, runs, rooms_study.SHIPPED)
    assert again[0] == rows[0]
    assert len(list((tmp_path / "drives").glob("ppo-rooms*"))) == 4  # two settings, with and without the layer
