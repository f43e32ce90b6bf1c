"""The study: its text follows from its numbers, losses first; published pages agree with it; and it resumes."""

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
pretrained, publish, robustness, rooms_study, scenarios, text = map(
    import_module, ("pretrained", "publish", "robustness", "rooms_study", "scenarios", "robustness_text")
)


def interval(value, low, high):
    return {"value": value, "low": low, "high": high}


def row(scenario, untuned, tuned, ppo, margin, verdict):
    """Return a comparison as the study writes it."""
    gap = ppo - tuned
    return {
        "scenario": scenario,
        "compared_with": "bearing",
        "baselines": [{"policy": "bearing", "time": interval(tuned, 0, 99), "time_untuned": interval(untuned, 0, 99)}],
        "ppo": {
            "trainings": 5,
            "episodes": 2000,
            "time": interval(ppo, ppo - 0.3, ppo + 0.3),
            "difference": interval(gap, gap - margin, gap + margin),
        },
        "p_holm": 0.01,
        "verdict": verdict,
    }


RESULTS = {
    "config": {"seeds": 5, "episodes": 2000, "first_seed": 1_000_000, "tries": 40},
    "comparisons": [
        row("Nav, raw odometry, tutorial", 16.5, 12.16, 12.18, 0.1, "no difference found"),
        row("Nav, estimate, tutorial", 10.34, 10.3, 10.45, 0.05, "PPO slower"),
        row("Nav, wheel", 12.0, 11.9, 11.0, 0.2, "PPO faster"),
    ],
    "false_arrivals": [{"noise": "tutorial", "policy": "bearing", "false_arrival": interval(0.39, 0.37, 0.411)}],
}


def test_losses_of_learning_are_reported_first():
    assert text.summary(RESULTS) == [
        "* **PPO is slower than the tuned baseline in 1 of 3 scenarios**: Nav, estimate, tutorial "
        "(10.45 s to 10.30 s: +0.15 s, +0.10 to +0.20).",
        "* **No difference is found in 1**: Nav, raw odometry, tutorial (12.18 s to 12.16 s: +0.02 s, -0.08 to +0.12).",
        "* **PPO is faster in 1**: Nav, wheel (11.00 s to 11.90 s: -0.90 s, -1.10 to -0.70).",
        "* **Against the baselines' defaults PPO would have won 1 more**: "
        "Nav, raw odometry, tutorial (16.50 s instead of 12.16 s).",
        "* **What the filter buys**, from raw odometry to its estimate: "
        "`tutorial` 12.16 s to 10.30 s for geometry, 12.18 s to 10.45 s for PPO.",
        "* **Where the episode ends on belief**, which must be inside by a margin, the robot is not within 0.15 m "
        "in 39.0 % (37.0 to 41.1) under `tutorial` (the bearing law, 2000 episodes each).",
    ]
    assert text.headline(RESULTS) == (
        "PPO is slower than the tuned baseline in 1 of 3 scenarios. No difference is found in 1. PPO is faster in 1. "
        "Against the baselines' defaults PPO would have won 1 more."
    )
    assert "5 trainings (seeds 0 to 4) and 2000 paired episodes (seeds from 1,000,000)" in text.conditions(RESULTS)
    assert "Holm's correction for 3 scenarios" in text.conditions(RESULTS)


def test_a_verdict_needs_the_corrected_p_value():
    for p, difference, verdict in (
        (0.049, -0.1, "PPO faster"),
        (0.049, 0.1, "PPO slower"),
        (0.05, -0.1, "no difference found"),
        (1.0, 0.1, "no difference found"),
    ):
        assert robustness.verdict({"p_holm": p, "ppo": {"difference": Interval(difference, -9.0, 9.0)}}) == verdict


def test_the_readme_agrees_with_the_published_study():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    findings = publish.findings(ROOT / "benchmarks" / "robustness.json")
    assert findings in readme
    assert publish.between(readme, findings, publish.BEGIN, publish.END) == readme
    with pytest.raises(ValueError, match="The page must hold"):
        publish.between("nothing", "something", publish.BEGIN, publish.END)


def test_every_published_claim_has_five_trainings_and_its_seeds():
    study = json.loads((ROOT / "benchmarks" / "robustness.json").read_text(encoding="utf-8"))
    assert study["comparisons"]
    for row in study["comparisons"]:
        ppo, seeds = row["ppo"], row["seeds"]
        assert ppo["trainings"] == len(ppo["time_of_each_training"]) == len(seeds["training"]) >= 5
        first, end = seeds["evaluation"]
        assert ppo["episodes"] == end - first >= 2000
        assert row["compared_with"] == row["baselines"][0]["policy"]
        difference = Interval(**ppo["difference"])
        assert row["verdict"] == robustness.verdict({"p_holm": row["p_holm"], "ppo": {"difference": difference}})
        assert len(row["commits"]) == 1
        assert not row["commits"][0].endswith("-dirty")


def test_scenarios_have_files_of_their_own():
    names = [scenarios.slug(**options) for options in robustness.SCENARIOS.values()]
    assert len(set(names)) == len(names)
    assert max(map(len, names)) < 100
    assert scenarios.slug(**robustness.SCENARIOS["Nav, no reverse, tutorial"]) == "TurtleBotNav-v0-ekf-tutorial-reverse-False"
    assert scenarios.slug(**pretrained.scenario("pose", "tutorial")) == scenarios.slug(
        **robustness.SCENARIOS["Pose, tutorial"]
    )  # tuned once
    assert scenarios.short("46bf714aaaabbbbccccdddd-dirty") == "46bf714aaaab-dirty"
    assert scenarios.short(None) == "unknown"


def test_the_figure_has_a_line_and_a_bar_for_each_scenario(tmp_path):
    figure = import_module("robustness_figure").draw(RESULTS["comparisons"])
    figure.savefig(tmp_path / "figure.png")
    left, right = figure.axes
    lines = [label.get_text().partition("\n")[0] for label in left.get_yticklabels()]
    assert lines == [comparison["scenario"] for comparison in RESULTS["comparisons"]]
    assert [bar.get_width() for bar in right.patches] == pytest.approx([16.5 - 12.16, 10.34 - 10.3, 12.0 - 11.9])
    assert len({container.lines[0].get_color() for container in left.containers}) == 3


@pytest.fixture
def small(tmp_path):
    return robustness.Config(seeds=2, steps=1024, episodes=12, tries=2, processes=1, out=tmp_path)


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
    assert compared["ppo"]["success"]["value"] == 0.0  # after a thousand steps
    files = sorted(path.relative_to(tmp_path).as_posix() for path in tmp_path.glob("*/*.json"))
    assert [path for path in files if path.startswith("tuned")] == [
        "tuned/bearing-TurtleBotSquare-v0-ekf-tutorial.json",
        "tuned/corner-TurtleBotSquare-v0-ekf-tutorial.json",
    ]


def test_a_card_states_its_losses_first_and_its_origin(small, tmp_path):
    config = pretrained.Config(seeds=1, steps=1024, episodes=12, tries=1, tasks=("nav",), out=tmp_path)
    (training,) = scenarios.trainings(tmp_path, config.steps, config.seeds, pretrained.NAV)
    run = training()
    assert scenarios.best_of_trainings([run]) == run
    bundle = run / "policy.onnx"
    rows = pretrained.compared(config, tmp_path, bundle, "nav")
    text = pretrained.card("nav", config, bundle, rows)
    losses = "Slower than the tuned `bearing` (tutorial), `bearing` (documented), `bearing` (rough).\n"
    assert text.startswith(f"# ppo-nav\n\n{losses}")
    assert "12 episodes on seeds from 2,000,000" in text
    assert "--randomize --seed 0`" in text
    assert text.count("| ppo-nav |") == 3


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


def test_the_study_of_rooms_drives_each_policy_and_every_training(tmp_path):
    config = rooms_study.Config(policy=("bearing",), seeds=2, steps=1024, only=("dense", "map"), episodes=12, processes=1)
    runs = [train() for train in scenarios.trainings(tmp_path, config.steps, config.seeds, rooms_study.ROOMS)]
    bundle = scenarios.best_of_trainings(runs) / "policy.onnx"
    rows = rooms_study.study(config, tmp_path, runs, str(bundle))
    assert len(list((tmp_path / "drives").iterdir())) == 2 * 5  # each once: bearing, vfh, two trainings, one within the layer
    kinds = ["bearing", "vfh", "ppo-rooms", "ppo-rooms+safety", "ppo, 2 trainings"]
    assert [(row["setting"], row["policy"]) for row in rows] == [(name, kind) for name in config.only for kind in kinds]
    for row in rows:
        assert row["success"].value + row["collision"].value + row["timeout"].value == pytest.approx(1.0)
    assert rows[1]["success_difference"].value == 0.0  # with itself
    assert [row["policy"] for row in rows if "later" in row] == ["ppo-rooms+safety"] * 2
    card = rooms_study.card(bundle, rows, config)
    assert "\nSucceeds less often than `vfh` in `dense`, `map`.\n" in card
    assert card.count("| ppo-rooms |") == card.count("| vfh |") == 2
    assert "--randomize --seed" in card
    assert "12 rooms of each setting, on seeds from 1,000,000" in card
    kept = replace(config, keep=True, only=("dense", "dense, truth, noise rough"))
    again = rooms_study.study(kept, tmp_path, runs, rooms_study.SHIPPED)
    assert again[0] == rows[0]
    assert len(list((tmp_path / "drives").glob("ppo-rooms*"))) == 4  # two settings, with and without the layer
    assert "of some earlier trainings the best" in rooms_study.card(bundle, again, kept)
