"""Episodes from records: a record written down by hand, and every number of its episodes worked out by hand."""

import math
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from turtlebot_gym import Robot, Task
from turtlebot_gym.systems import make_parameters
from turtlebot_gym_agents.evaluation import metrics
from turtlebot_gym_agents.evaluation.episodes import Record, concatenate, measure
from turtlebot_gym_agents.evaluation.evaluate import BATCH, evaluate

NAN = math.nan
ROBOT = Robot(max_linear=0.5, max_angular=2.0, max_wheel=0.4)
TASK = Task(random=False, radius=0.3)
FAR = 9.0
"""What a record holds after an episode's end is another episode's, and must not count."""


def rows(*poses, twist=(0.0, 0.0)):
    return np.array([[*pose, *twist] if len(pose) == 3 else pose for pose in poses], np.float64)


def record():
    """Return four steps of three environments.

    The first has two waypoints, (1, 0) and (1, 1), and comes to its time limit. The second reaches (0, 1) in two steps, and
    the third is cut off after one.
    """
    ended = (FAR, FAR, FAR)
    true = np.stack(
        [
            rows((0.0, 0.0, 0.0), (0.4, 0.0, -3.1), (0.8, 0.0, 0.1), (1.0, 0.1, 0.2), (1.0, 0.5, 0.3)),
            rows((0.0, 0.0, 0.0), (0.0, 0.5, 0.0), (0.0, 0.8, 0.0), ended, ended),
            rows((0.0, 0.0, 0.0), (0.0, -0.1, 0.0), ended, ended, ended),
        ],
        axis=1,
    )
    believed = np.stack(
        [
            rows((0.05, 0.0, 0.0), (0.45, 0.0, 3.1), (0.76, 0.0, 0.3), (0.9, 0.0, 0.2), (1.0, 0.9, 0.2)),
            true[:, 1],
            true[:, 2],
        ],
        axis=1,
    )
    odometry = true[..., :3] + (0.3, 0.4, 0.0)
    reference = np.array(
        [
            [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 2.0, 0.0)],
            [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 2.0, 0.0)],
            [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (FAR, FAR, 0.0)],
            [(1.0, 1.0, 0.0), (FAR, FAR, 0.0), (FAR, FAR, 0.0)],
            [(1.0, 1.0, 0.0), (FAR, FAR, 0.0), (FAR, FAR, 0.0)],
        ]
    )
    command = np.array(
        [
            [(FAR, FAR), (FAR, FAR), (FAR, FAR)],
            [(0.5, 0.0), (0.5, 0.0), (0.0, 1.0)],
            [(0.25, 1.0), (-0.5, -2.0), (FAR, FAR)],
            [(0.0, 0.0), (FAR, FAR), (FAR, FAR)],
            [(0.25, 0.0), (FAR, FAR), (FAR, FAR)],
        ]
    )
    yes, no = True, False
    return Record(
        true_state=true,
        odometry=odometry,
        estimate=believed,
        reference=reference,
        command=command,
        is_success=np.array([[no, no, no], [no, no, no], [no, yes, yes], [no, no, yes], [no, no, yes]]),
        collision=np.array([[no, no, no], [yes, no, no], [no, no, no], [no, no, yes], [no, yes, no]]),
        clearance=np.array([[0.9, 0.8, 0.2], [0.7, 0.3, 0.4], [0.8, 0.5, -FAR], [0.75, -FAR, -FAR], [0.9, -FAR, -FAR]]),
        way_left=np.array([[3.0, 2.0, 5.0], [FAR] * 3, [FAR] * 3, [FAR] * 3, [FAR] * 3]),
        running=np.array([[yes, yes, yes], [yes, yes, yes], [yes, yes, no], [yes, no, no], [yes, no, no]]),
        covariance=np.arange(5.0)[:, None, None] * np.eye(5),
    )


def measured(observation="ekf"):
    return measure(record(), make_parameters(TASK, robot=ROBOT, dt=0.25, observation=observation), 70)


def test_what_became_of_each_episode():
    e = measured()
    assert e.seed.tolist() == [70, 71, 72]
    assert e.success.tolist() == [False, True, False]
    assert e.time.tolist() == [1.0, 0.5, 0.25]
    # to the first waypoint, from there to the next, and not the last 0.3 m; at 0.4 m/s, which the wheels allow
    np.testing.assert_allclose(e.ideal, [1.7 / 0.4, 0.7 / 0.4, 1.7 / 0.4])
    np.testing.assert_allclose(e.path, [0.4 + 0.4 + math.sqrt(0.05) + 0.4, 0.8, 0.1])
    np.testing.assert_allclose(e.effort, [(1.0 + 0.5 + 0.0 + 0.25) / 4.0, (1.0 + 2.0) / 2.0, 0.25])
    assert e.reached.tolist() == [1, 1, 0]
    np.testing.assert_allclose(e.miss, [(0.1 + 0.5) / 2.0, 0.2, 2.1])
    assert e.collision.tolist() == [True, False, False]
    assert e.clearance.tolist() == [0.7, 0.3, 0.2]
    np.testing.assert_allclose(e.shortest, np.array([3.0, 2.0, 5.0]) - TASK.radius)


@pytest.mark.parametrize(
    ("observation", "distances", "false"),
    [
        # Believed at the first waypoint, by the margin, 0.2 m away from it, which is near enough, and at the second 0.5 m away,
        # which is not.
        ("ekf", [(0.2 + 0.5) / 2.0, 0.2, NAN], [True, False, False]),
        ("truth", [0.2, 0.2, NAN], [False, False, False]),
        # 0.5 m off: the second robot seems to be at (0.3, 0.9) after its first step, 0.316 m away; then at (0.3, 1.2).
        ("odometry", [NAN, NAN, NAN], [False, False, False]),
    ],
)
def test_arrivals_are_those_of_the_pose_that_the_policy_sees(observation, distances, false):
    e = measured(observation)
    np.testing.assert_allclose(e.arrival_distance, distances)
    assert e.false_arrival.tolist() == false


def test_errors_are_counted_over_the_steps_of_the_episode():
    e, turn = measured(), 2.0 * math.pi - 6.2  # from 3.1 to -3.1 rad
    position = {"mean": (0.05 + 0.04 + math.sqrt(0.02) + 0.4) / 4.0, "max": 0.4, "final": 0.4}
    heading = {"mean": (turn + 0.2 + 0.0 + 0.1) / 4.0, "max": 0.2, "final": 0.1}
    for over in ("mean", "max", "final"):
        np.testing.assert_allclose(getattr(e.estimate, f"position_{over}"), [position[over], 0.0, 0.0], atol=1e-15)
        np.testing.assert_allclose(getattr(e.estimate, f"heading_{over}"), [heading[over], 0.0, 0.0], atol=1e-15)
        np.testing.assert_allclose(getattr(e.odometry, f"position_{over}"), 0.5)
        np.testing.assert_allclose(getattr(e.odometry, f"heading_{over}"), 0.0, atol=1e-15)


@pytest.mark.parametrize(
    ("row", "places", "reached"),
    [
        (1, [(0.0, 0.7)], [1, 0, 0]),  # 1 - 0.7 is a little more than the radius of 0.3
        (0, [(0.6, 0.0), (0.65, 0.1), (1.0, 0.9)], [1, 1, 0]),  # 0.4 and 0.36 m from the first waypoint, 0.1 m from the second
    ],
)
def test_a_waypoint_is_reached_strictly_within_its_radius_and_while_it_is_due(row, places, reached):
    r = record()
    r.true_state[2 : 2 + len(places), row, :2] = places
    assert measure(r, make_parameters(TASK, robot=ROBOT, dt=0.25), 0).reached.tolist() == reached


def test_the_trajectory_is_the_first_environments():
    drive = record().trajectory(dt=0.25)
    np.testing.assert_array_equal(drive.time, [0.0, 0.25, 0.5, 0.75, 1.0])
    np.testing.assert_array_equal(drive.true_state, record().true_state[:, 0])
    np.testing.assert_array_equal(drive.covariance[:, 0, 0], [0.0, 1.0, 2.0, 3.0, 4.0])
    short = record()
    short.running[3:, 0] = False
    assert short.trajectory(dt=0.25).time.tolist() == [0.0, 0.25, 0.5]
    assert short.trajectory(dt=0.25).covariance.shape == (3, 5, 5)


def test_batches_follow_each_other():
    one, other = measured(), measured("odometry")
    both = concatenate([one, other])
    assert both.seed.tolist() == [70, 71, 72, 70, 71, 72]
    np.testing.assert_array_equal(both.arrival_distance, [*one.arrival_distance, *other.arrival_distance])
    np.testing.assert_array_equal(both.estimate.heading_max, [*one.estimate.heading_max, *other.estimate.heading_max])


# The numbers over many episodes.


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


def test_errors_of_several_drives_at_once():
    truth = np.zeros((3, 2, 3))
    poses = np.array([[(3.0, 4.0, 0.1), (0.0, 1.0, -0.2)], [(0.0, 2.0, 0.4), (NAN,) * 3], [(0.0, 1.0, -0.1), (NAN,) * 3]])
    got = metrics.errors(poses, truth)
    np.testing.assert_allclose(got.position_mean, [8.0 / 3.0, 1.0])
    np.testing.assert_allclose(got.position_max, [5.0, 1.0])
    np.testing.assert_allclose(got.position_final, [1.0, 1.0])
    np.testing.assert_allclose(got.heading_mean, [0.2, 0.2])
    np.testing.assert_allclose(got.heading_max, [0.4, 0.2])
    np.testing.assert_allclose(got.heading_final, [0.1, 0.2])


SQUARE = "turtlebot_gym/TurtleBotSquare-v0"


def test_an_evaluation_says_what_was_evaluated_and_closes_its_environments(monkeypatch):
    made, make = [], gym.make_vec
    monkeypatch.setattr(gym, "make_vec", lambda *given, **options: made.append(make(*given, **options)) or made[-1])
    result = evaluate("proportional", max_episode_steps=2, noise="clean")
    assert result.config == {
        "env": "turtlebot_gym/TurtleBotNav-v0",
        "policy": "proportional",
        "episodes": 1000,
        "seed": 0,
        "noise": "clean",
        "max_episode_steps": 2,
    }
    assert result.episodes.seed.tolist() == list(range(1000))
    assert repr(result) == "Evaluation(limit=0.2)"  # in a notebook, not pages of arrays
    limits = [evaluate("proportional", episodes=1, **options).limit for options in ({}, {"env": SQUARE, "dt": 0.05})]
    assert limits == [30.0, 30.0]  # 300 steps of 0.1 s, 600 of 0.05 s
    assert BATCH == 1024
    monkeypatch.setattr("turtlebot_gym_agents.evaluation.evaluate.BATCH", 2)
    evaluate("proportional", episodes=4, max_episode_steps=2)
    assert [envs.closed for envs in made] == [True] * 5


def test_the_summary_is_made_of_the_episodes():
    result = evaluate("bearing", episodes=60, seed=9, max_episode_steps=110)
    e, summary = result.episodes, result.summary()
    assert 5 < e.success.sum() < 55  # else successes and failures were the same
    times = np.where(e.success, e.time, 11.0)
    expected = {
        name: np.nanmean(getattr(e, name)) for name in ("success", "reached", "miss", "path", "effort", "false_arrival")
    }
    expected |= {"time": times.mean(), "time_to_goal": e.time[e.success].mean()}
    expected |= {"efficiency": (e.ideal / e.time)[e.success].mean(), "arrival_distance": np.nanmean(e.arrival_distance)}
    for source in ("estimate", "odometry"):
        for what in ("position", "heading"):
            for over in ("mean", "max", "final"):
                expected[f"{source}_{what}_{over}"] = getattr(getattr(e, source), f"{what}_{over}").mean()
    assert summary.keys() == expected.keys()
    for name, number in expected.items():
        assert summary[name].value == pytest.approx(number, rel=1e-9), name
        assert summary[name].low <= number <= summary[name].high, name
    np.testing.assert_array_equal(result.times(), times)


@pytest.mark.parametrize("max_linear", [0.05, 0.22, 0.6, 20.0])
def test_the_summary_of_rooms_is_made_of_the_episodes(max_linear):
    """The challenge clips times at two and at eight times the fastest: the speeds meet both ends and what lies between."""
    result = evaluate("bearing", env="turtlebot_gym/TurtleBotRooms-v0", world="dense", episodes=60, max_episode_steps=110)
    assert result.max_linear == 0.2108  # the wheels allow of no more
    result = replace(result, max_linear=max_linear)
    e, summary = result.episodes, result.summary()
    fastest = e.shortest / max_linear
    scores = [s * f / min(max(t, 2.0 * f), 8.0 * f) for s, f, t in zip(e.success, fastest, e.time, strict=True)]
    timeouts = [not success and not collision for success, collision in zip(e.success, e.collision, strict=True)]
    assert min(e.success.sum(), e.collision.sum(), sum(timeouts)) > 3  # else they could not be told apart
    assert summary["barn"].value == pytest.approx(np.mean(scores), rel=1e-9)
    assert summary["timeout"].value == pytest.approx(np.mean(timeouts), rel=1e-9)
    assert summary["collision"].value == pytest.approx(e.collision.mean(), rel=1e-9)
    assert summary["clearance"].value == pytest.approx(e.clearance.mean(), rel=1e-9)
    assert summary["clearance_5th"].value == pytest.approx(np.quantile(e.clearance, 0.05), abs=0.01)
    spl = [s * a / max(p, a) for s, a, p in zip(e.success, e.shortest, e.path, strict=True)]
    assert summary["spl"].value == pytest.approx(np.mean(spl), rel=1e-9)


@pytest.mark.parametrize(
    ("name", "value", "rule"),
    [
        *(("episodes", value, "at least 1") for value in (0, -1, 1.0)),
        *(("seed", value, "from 0 to 9223372036854775807") for value in (-1, 0.5)),
    ],
)
def test_counts_are_whole_numbers(name, value, rule):
    with pytest.raises(ValueError, match=f"^{name} must be a whole number .*{rule}, got {value}\\.$"):
        evaluate("bearing", **{name: value})


def test_progress_counts_the_ended_episodes_of_all_batches(monkeypatch):
    monkeypatch.setattr("turtlebot_gym_agents.evaluation.evaluate.BATCH", 4)
    counts = []
    evaluate("proportional", episodes=10, max_episode_steps=3, noise="clean", progress=counts.append)
    assert counts == [0, 0, 4, 4, 4, 8, 8, 8, 10]
