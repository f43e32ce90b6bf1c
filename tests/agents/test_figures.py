"""Figures of drives, filters and trainings: they show what is there, with units and bounds."""

import math

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from scipy import stats

from turtlebot_gym.drive import Drive, RoomData
from turtlebot_gym.rooms.scan import Obstacles
from turtlebot_gym_agents.evaluation.evaluate import evaluate
from turtlebot_gym_agents.figures import learning_figure, plot_consistency, plot_drive, plot_learning

ROOM = Obstacles((0.0, 0.0, 10.0, 8.0), ((1.0, 1.0, 0.3), (-1.0, 1.0, 0.25)), ((2.0, 0.0, 0.4, 0.2, 0.3),))


@pytest.fixture
def axes():
    return Figure(layout="constrained").subplots()


def drive() -> Drive:
    """Return a drive of 1 m along x from the origin."""
    poses = np.linspace((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 30)
    odometry = poses + np.random.default_rng(0).normal(0.0, 0.1, poses.shape)
    return Drive(
        time=0.1 * np.arange(30),
        true_state=poses,
        estimate=poses + 0.02,
        odometry=odometry,
        reference=np.tile([1.0, 0.1, 0.0], (30, 1)),
        around=RoomData(label="a", room=ROOM),
    )


def line(axes, label):
    (found,) = [line for line in axes.lines if line.get_label() == label]
    return found


def test_a_drive_in_a_room_has_walls_obstacles_and_a_view_of_its_path(axes):
    assert plot_drive(axes, drive()) is axes
    kinds = [type(patch) for patch in axes.patches]
    assert (kinds.count(Rectangle), kinds.count(Circle)) == (2, 3)  # walls and box, obstacles and circle of arrival
    labels = axes.get_legend_handles_labels()[1]
    assert {"truth", "estimate", "odometry", "waypoint", "start", "end"} <= set(labels)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x (m)", "y (m)")
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    assert right - left == pytest.approx(top - bottom)
    assert right - left < 3.0  # the path, and not the room of 20 m
    assert left < 0.0 < 1.0 < right
    assert bottom < 0.0 < 0.1 < top


@pytest.mark.parametrize("runs", [1, 50])
def test_consistency_is_a_mean_within_the_bounds_of_chi_square(axes, runs):
    """At 40 independent times a mean is outside in 5 % of them; the chance that it is at 10 or more is below 10^-4."""
    values = np.random.default_rng(1).chisquare(3, (runs, 40))
    assert plot_consistency(axes, 0.1 * np.arange(40), values) is axes
    (band,) = axes.collections
    heights = band.get_paths()[0].vertices[:, 1]
    low, high = stats.chi2.interval(0.95, 3 * runs) / np.float64(runs)
    assert (heights.min(), heights.max()) == pytest.approx((low, high))
    mean = line(axes, "NEES" if runs == 1 else f"mean NEES of {runs} runs").get_ydata()
    assert mean == pytest.approx(values.mean(axis=0))
    assert np.sum((mean < low) | (mean > high)) < 10
    assert np.sum(2.0 * mean > high) > 20 or runs == 1  # twice as sure as right is noticed
    assert axes.get_xlabel() == "time (s)"
    assert line(axes, "expected: 3").get_ydata()[0] == 3


def test_a_learning_curve_is_the_mean_of_seeds_with_its_interval(axes):
    shares = [(0.2, 0.6), (0.4, 0.9), (0.6, 0.9)]
    runs = [[{"steps": 1000.0 * (at + 1), "success": value, "return": value} for at, value in enumerate(run)] for run in shares]
    assert plot_learning(axes, runs) is axes
    assert line(axes, "mean of 3 seeds").get_ydata() == pytest.approx([40.0, 80.0])
    assert len(axes.lines) == 4  # and one of each seed
    heights = axes.collections[0].get_paths()[0].vertices
    margin = 4.302653 * 20.0 / math.sqrt(3.0)  # the 97.5 % point of Student's t with 2 degrees of freedom
    assert np.ptp(heights[heights[:, 0] == 1000.0, 1]) == pytest.approx(2.0 * margin)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("training steps", "goals reached (%)")
    alone = Figure().subplots()
    plot_learning(alone, runs[:1], measure="return")
    assert not alone.collections
    assert line(alone, "one seed").get_ydata().tolist() == [0.2, 0.6]
    with pytest.raises(ValueError, match="at least one run each"):
        plot_learning(axes, [[], runs[0]])
    assert len(learning_figure(runs, title="Nav").axes) == 2


def test_the_outcome_counts_the_waypoints_of_a_task_with_several():
    evaluation = evaluate("bearing", env="turtlebot_gym/TurtleBotSquare-v0", episodes=1)
    assert evaluation.trajectory.outcome == f"4 of 4 waypoints, success after {evaluation.episodes.time[0]:.1f} s"
    evaluation = evaluate("bearing", env="square", robot="tutorial", switch="time", episodes=2)
    assert evaluation.trajectory.outcome == "4 waypoints reached, time is up after 60.0 s"
    assert evaluation.verdict() == "bearing reaches 4.00 to 4.00 waypoints."
