"""Evaluation: its numbers are those of the scalar environment, counted by hand; and it distinguishes policies and filters."""

import json
import math
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

import turtlebot_gym
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.values import Pose
from turtlebot_gym_agents import make_policy
from turtlebot_gym_agents.evaluation import evaluate as evaluation
from turtlebot_gym_agents.evaluation import metrics
from turtlebot_gym_agents.evaluation.evaluate import evaluate
from turtlebot_gym_agents.ids import SHORT
from turtlebot_gym_agents.provenance import plain, write_json

NAV, SQUARE, ROOMS = SHORT["nav"], SHORT["square"], SHORT["rooms"]
SLOW = pytest.mark.slow


def by_hand(policy: str, seed: int, *, env: str, **options) -> dict[str, float]:
    """Return an episode's numbers from the scalar environment, one step after the other."""
    world = gym.make(env, **options)
    p = world.unwrapped.parameters
    radius = p.task.radius
    drive = make_policy(policy, robot=p.robot, dt=p.dt)
    observation, info = world.reset(seed=seed)
    steps, path, effort, success, ended = 0, 0.0, 0.0, False, False
    errors = {"estimate": [], "odometry": []}
    misses, reached, believed_at, false_arrival = [], [False], [None], False
    given, arrivals, false_arrivals, astray, collision = 0, 0, 0, 0, False
    clearances, shortest = [info.get("clearance", math.nan)], info.get("way_left", math.nan) - radius
    due = info["reference"]
    ideal = math.dist(info["true_state"][:2], due[:2]) - radius
    while not ended:
        before = info["true_state"]
        observation, _, terminated, truncated, info = world.step(drive(observation))
        steps += 1
        ended, success = terminated or truncated, success or info["is_success"]
        true, command = info["true_state"], info["command"]
        path += math.dist(before[:2], true[:2])
        effort += (command[0] / p.robot.max_linear) ** 2 + (command[1] / p.robot.max_angular) ** 2
        for name, rows in errors.items():
            rows.append((math.dist(info[name][:2], true[:2]), abs(wrap(info[name][2] - true[2]))))
        away = math.dist(true[:2], due[:2])
        collision = bool(info.get("collision", False))
        clearances.append(info.get("clearance", math.nan))
        shown = {"ekf": info["estimate"], "odometry": info["odometry"], "truth": true}[options.get("observation", "ekf")]
        reached[-1] |= away < radius
        believed_there, astray = math.dist(shown[:2], due[:2]) < radius - 0.05, astray + (math.dist(shown[:2], true[:2]) > 0.5)
        if believed_at[-1] is None and believed_there:  # by the margin
            believed_at[-1] = away
            false_arrival |= away >= radius
        if ended or not np.array_equal(info["reference"], due):
            misses.append(away)
            if terminated or not ended:
                given, arrivals = given + 1, arrivals + (away < radius and not collision)
                false_arrivals += believed_there and away >= radius
            ideal += math.dist(info["reference"][:2], due[:2])
            due = info["reference"]
            if not ended:
                reached.append(False)
                believed_at.append(None)
    world.close()
    believed = [away for away in believed_at if away is not None]
    numbers = {
        "success": success,
        "time": steps * p.dt,
        "ideal": ideal / min(p.robot.max_linear, p.robot.max_wheel),
        "path": path,
        "effort": effort / steps,
        "reached": sum(reached),
        "given": given,
        "arrivals": arrivals,
        "false_arrivals": false_arrivals,
        "miss": np.mean(misses),
        "false_arrival": false_arrival,
        "arrival_distance": np.mean(believed) if believed else math.nan,
        "astray": astray / steps,
        "collision": collision,
        "clearance": min(clearances),
        "shortest": shortest,
    }
    for name, rows in errors.items():
        for quantity, column in zip(("position", "heading"), np.array(rows).T, strict=True):
            numbers |= {f"{name}_{quantity}_mean": column.mean(), f"{name}_{quantity}_max": column.max()}
            numbers |= {f"{name}_{quantity}_final": column[-1]}
    return numbers


@pytest.mark.parametrize(
    ("policy", "options"),
    [
        ("bearing", {"env": NAV}),
        ("proportional", {"env": NAV, "observation": "odometry", "noise": "rough"}),
        pytest.param("bearing", {"env": NAV, "arrival": "belief", "robot": "tutorial", "dt": 0.05}, marks=SLOW),
        pytest.param("bearing", {"env": SQUARE, "laps": 2}, marks=SLOW),
        pytest.param("proportional", {"env": SQUARE, "switch": "time", "robot": "tutorial", "filter": "tutorial"}, marks=SLOW),
        pytest.param("bearing", {"env": ROOMS, "world": "dense", "lidar": "ideal"}, marks=SLOW),
    ],
)
def test_an_episode_is_that_of_the_scalar_environment(policy, options):
    result = evaluate(policy, episodes=3, seed=40, **options)
    for row in range(3):
        expected = by_hand(policy, 40 + row, **options)
        e = result.episodes
        actual = {name: getattr(e, name)[row] for name in e._fields if name not in ("seed", "estimate", "odometry")}
        for source in ("estimate", "odometry"):
            actual |= {f"{source}_{name}": values[row] for name, values in getattr(e, source)._asdict().items()}
        assert actual.keys() == expected.keys()
        for name, number in expected.items():
            assert actual[name] == pytest.approx(number, rel=1e-9, abs=1e-12, nan_ok=True), name
    np.testing.assert_array_equal(result.episodes.seed, [40, 41, 42])
    assert options["env"] != ROOMS or 0 < result.episodes.collision.sum() < 3


def test_episodes_do_not_depend_on_the_batch_at_whose_start_memory_is_reset(monkeypatch):
    masks, bearing = [], make_policy("bearing")

    class Remembers:
        def __call__(self, observations):
            assert masks
            return bearing(observations)

        def reset(self, mask):
            masks.append(mask.tolist())

    whole = evaluate("bearing", episodes=7, noise="rough", consistency=True)
    monkeypatch.setattr(evaluation, "BATCH", 3)
    parts = evaluate(Remembers(), episodes=7, noise="rough", consistency=True)
    assert whole.summary() == parts.summary()
    for name, values in whole.episodes._asdict().items():
        np.testing.assert_array_equal(values, getattr(parts.episodes, name))
    for one, other in zip(whole.consistency, parts.consistency, strict=True):
        np.testing.assert_array_equal(one, other)
    assert masks == [[True] * 3, [True] * 3, [True]]


def test_the_interval_of_a_share_of_sums_ends_at_what_is_possible():
    given, reached = np.array([10.0, 11.0]), np.array([10.0, 9.0])
    assert metrics.ratio(reached, given).high > 1.0
    share = metrics.ratio(reached, given, 1.0)
    assert (share.value, share.high) == (pytest.approx(19 / 21), 1.0)
    assert metrics.ratio(np.array([0.0, 1.0]), given).low == 0.0


def test_quantile_intervals_have_the_stated_coverage():
    random = np.random.default_rng(2)
    intervals = [metrics.quantile(random.exponential(size=200), 0.05) for _ in range(1000)]
    truth = -np.log(0.95)
    assert (
        0.94 < np.mean([interval.low <= truth <= interval.high for interval in intervals]) < 0.99
    )  # ranks are integers: > 95 %
    assert np.mean([interval.value for interval in intervals]) == pytest.approx(truth, rel=0.05)
    assert metrics.quantile([3.0], 0.05) == (3.0, 3.0, 3.0)


def test_results_carry_their_provenance(tmp_path):
    result = evaluate("proportional", episodes=3, noise="clean")
    path = tmp_path / "new" / "result.json"
    write_json(path, {"summary": result.summary(), "episodes": result.episodes}, config=result.config)
    text = path.read_text()
    assert "NaN" not in text
    content = json.loads(text)
    assert content["config"] == result.config
    assert content["version"] == turtlebot_gym.__version__
    assert content["libraries"]["numpy"] == np.__version__
    assert content["summary"]["success"].keys() == {"value", "low", "high"}
    np.testing.assert_allclose(content["episodes"]["time"], result.episodes.time)
    np.testing.assert_allclose(
        content["episodes"]["estimate"]["position_mean"], result.episodes.estimate.position_mean, rtol=1e-6
    )
    assert plain({"a": np.float64("nan"), "b": (np.int64(1), np.bool_(True))}) == {"a": None, "b": [1, True]}


# Summaries and progress.


@pytest.mark.parametrize(
    ("numbers", "mean", "margin"),
    [
        ([1.0, 2.0, 3.0, 4.0, math.nan, math.inf], 2.5, 3.182446 * math.sqrt(5.0 / 3.0) / 2.0),  # 3 degrees of freedom
        ([1.0, 3.0], 2.0, 12.7062047),
        ([2.0], 2.0, math.nan),
        ([], math.nan, math.nan),
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


def test_the_summary_of_missions_follows_from_the_episodes():
    result = evaluate("bearing", env="turtlebot_gym/TurtleBotMissions-v0", episodes=2, max_episode_steps=20)
    columns = {"arrivals": (3, 1), "given": (5, 3), "false_arrivals": (0, 2), "time": (100.0, 300.0), "astray": (0.5, 0.1)}
    episodes = result.episodes._replace(**{name: np.array(column) for name, column in columns.items()})
    summary = replace(result, episodes=episodes).summary()
    expected = {"goals": 0.5, "false_goals": 0.25, "goals_an_hour": 36.0, "lost": 0.2}
    assert {name: summary[name].value for name in expected} == pytest.approx(expected)


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
