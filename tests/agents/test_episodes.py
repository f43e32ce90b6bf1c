"""Evaluations as a whole: configuration, summaries and progress; single episodes are in `test_evaluation`."""

import math
from dataclasses import replace

import numpy as np
import pytest

from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.values import Pose
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


@pytest.mark.parametrize("max_linear", [0.05, 0.22, 0.6, 20.0])
def test_the_summary_of_rooms_follows_from_the_episodes(max_linear):
    """The challenge clips times at two and at eight times the fastest: the speeds cover both ends and the range between."""
    result = evaluate("bearing", env="rooms", world="dense", episodes=60, max_episode_steps=110)
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


def test_metrics_of_one_drive_follow_from_its_geometry():
    """2 m straight on, 0.6 m from a wall: the least clearance is 0.6 - 0.105 m, and the way is as short as it can be."""
    plan = FloorPlan(walls=(0.0, 0.0, 3.0, 3.0), start=Pose(-1.0, 2.4, 0.0), goal=Pose(1.0, 2.4, 0.0))
    evaluation = evaluate("bearing", env="rooms", world=plan, lidar="ideal", noise="clean", episodes=1)
    assert evaluation.episodes.clearance == pytest.approx([0.495], abs=0.005)
    assert evaluation.episodes.path == pytest.approx([1.8], abs=0.03)
    assert evaluation.episodes.shortest == pytest.approx([1.8], abs=0.08)
    assert evaluation.summary()["spl"].value == pytest.approx(1.0, abs=0.05)
