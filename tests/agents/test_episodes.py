"""Evaluations as a whole: configuration, summaries and progress; single episodes are in `test_evaluation`."""

import math
from dataclasses import replace

import numpy as np
import pytest

from turtlebot_gym_agents.evaluation import metrics
from turtlebot_gym_agents.evaluation.evaluate import evaluate

NAN = math.nan


@pytest.mark.parametrize(
    ("numbers", "mean", "margin"),
    [
        ([1.0, 2.0, 3.0, 4.0, NAN, math.inf], 2.5, 3.182446 * math.sqrt(5.0 / 3.0) / 2.0),  # 3 degrees of freedom
        ([1.0, 3.0], 2.0, 12.7062047),
        ([2.0], 2.0, NAN),
        ([], NAN, NAN),
    ],
)
def test_students_interval_by_hand(numbers, mean, margin):
    """Its quantile of 97.5 %, from a table, times the standard error."""
    np.testing.assert_allclose(metrics.mean(numbers), (mean, mean - margin, mean + margin), rtol=1e-6)


def test_the_summary_follows_from_the_episodes():
    result = evaluate("bearing", episodes=60, seed=9, max_episode_steps=110)
    e, summary = result.episodes, result.summary()
    assert 5 < e.success.sum() < 55  # otherwise successes and failures would be the same
    times = np.where(e.success, e.time, 11.0)
    expected = {
        name: np.nanmean(getattr(e, name)) for name in ("success", "reached", "miss", "path", "effort", "false_arrival")
    }
    expected |= {"time": times.mean(), "time_to_goal": e.time[e.success].mean()}
    expected |= {"efficiency": (e.ideal / e.time)[e.success].mean(), "arrival_distance": np.nanmean(e.arrival_distance)}
    for source in ("estimate", "odometry"):
        for quantity in ("position", "heading"):
            for statistic in ("mean", "max", "final"):
                name = f"{quantity}_{statistic}"
                expected[f"{source}_{name}"] = getattr(getattr(e, source), name).mean()
    assert summary.keys() == expected.keys()
    for name, number in expected.items():
        assert summary[name].value == pytest.approx(number, rel=1e-9), name
        assert summary[name].low <= number <= summary[name].high, name
    np.testing.assert_array_equal(result.times(), times)


@pytest.mark.parametrize("max_linear", [0.05, 0.22, 0.6, 20.0])
def test_the_summary_of_rooms_follows_from_the_episodes(max_linear):
    """The challenge clips times at two and at eight times the fastest: the speeds cover both ends and the range between."""
    result = evaluate("bearing", env="turtlebot_gym/TurtleBotRooms-v0", world="dense", episodes=60, max_episode_steps=110)
    assert result.max_linear == 0.2108  # the wheels allow of no more
    result = replace(result, max_linear=max_linear)
    e, summary = result.episodes, result.summary()
    fastest = e.shortest / max_linear
    scores = [s * f / min(max(t, 2.0 * f), 8.0 * f) for s, f, t in zip(e.success, fastest, e.time, strict=True)]
    timeouts = [not success and not collision for success, collision in zip(e.success, e.collision, strict=True)]
    assert min(e.success.sum(), e.collision.sum(), sum(timeouts)) > 3  # otherwise they could not be distinguished
    assert summary["barn"].value == pytest.approx(np.mean(scores), rel=1e-9)
    assert summary["timeout"].value == pytest.approx(np.mean(timeouts), rel=1e-9)
    assert summary["collision"].value == pytest.approx(e.collision.mean(), rel=1e-9)
    assert summary["clearance"].value == pytest.approx(e.clearance.mean(), rel=1e-9)
    assert summary["clearance_5th"].value == pytest.approx(np.quantile(e.clearance, 0.05), abs=0.01)
    spl = [s * a / max(p, a) for s, a, p in zip(e.success, e.shortest, e.path, strict=True)]
    assert summary["spl"].value == pytest.approx(np.mean(spl), rel=1e-9)


def test_progress_counts_the_ended_episodes_of_all_batches(monkeypatch):
    monkeypatch.setattr("turtlebot_gym_agents.evaluation.evaluate.BATCH", 4)
    counts = []
    evaluate("proportional", episodes=10, max_episode_steps=3, noise="clean", progress=counts.append)
    assert counts == [4, 8, 10]
