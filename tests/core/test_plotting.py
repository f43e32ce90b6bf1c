"""Plots: what they draw is what happened, headings do not jump, and every axis names its unit."""

import re

import numpy as np
import pytest
from matplotlib.figure import Figure

from turtlebot_gym.drive import Drive, RoomData
from turtlebot_gym.plotting import ESTIMATE_WITHIN, draw_over_time, draw_trajectory, tutorial_figure

HAS_UNIT = re.compile(r".+ \((m|s|rad|m/s|rad/s)\)$")
SERIES = ["truth", "estimate", ESTIMATE_WITHIN, "odometry", "waypoint", "start"]


def drive(*, turns: float = 2.0) -> Drive:
    """Return a drive round a circle of 1 m: so many turns, with headings in [-pi, pi)."""
    rng, samples = np.random.default_rng(0), 200
    time, heading = 0.1 * np.arange(samples), np.linspace(0.0, 2.0 * np.pi * turns, samples)
    truth = np.stack([np.sin(heading), -np.cos(heading), heading, 0.0 * time + 0.2, 0.0 * time + 0.2], axis=-1)
    odometry = truth[:, :3] + 0.1 * rng.standard_normal((samples, 3))
    estimate = truth + 0.02 * rng.standard_normal((samples, 5))
    for pose in (truth, odometry, estimate):
        pose[:, 2] = (pose[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
    return Drive(
        time=time,
        true_state=truth,
        odometry=odometry,
        estimate=estimate,
        covariance=np.tile(0.0004 * np.eye(3), (samples, 1, 1)),
        reference=np.repeat([[1.0, 0.0, 0.5], [-1.0, 0.0, 3.1]], samples // 2, axis=0),
        command=truth[:, 3:].copy(),
        around=RoomData(goal_radius=0.3),
    )


def lines(draw, *arguments):
    """Return the lines that a function has drawn into axes, by their labels, and the axes."""
    axes = Figure().subplots()
    assert draw(axes, *arguments) is axes
    return {line.get_label(): line for line in axes.lines}, axes


def test_a_drive_from_above_shows_every_series_once_and_circles_of_arrival():
    driven = drive()
    drawn, axes = lines(draw_trajectory, driven)
    for label, pose in (("truth", driven.true_state), ("estimate", driven.estimate), ("odometry", driven.odometry)):
        np.testing.assert_array_equal(drawn[label].get_xydata(), pose[:, :2])
    np.testing.assert_array_equal(drawn["start"].get_xydata(), driven.true_state[:1, :2])
    assert {tuple(point) for point in drawn["waypoint"].get_xydata()} == {(1.0, 0.0), (-1.0, 0.0)}
    assert {(*patch.center, patch.radius) for patch in axes.patches} == {(1.0, 0.0, 0.3), (-1.0, 0.0, 0.3)}
    assert sorted(axes.get_legend_handles_labels()[1]) == sorted(SERIES)
    assert axes.get_aspect() == 1.0


def test_numbers_over_time_are_what_was_recorded():
    driven = drive()
    for at, what in enumerate(("x", "y")):
        drawn, _ = lines(draw_over_time, driven, what)
        for label, rows in (("truth", driven.true_state), ("odometry", driven.odometry), ("reference", driven.reference)):
            np.testing.assert_array_equal(drawn[label].get_ydata(), rows[:, at])
    for at, what in enumerate(("v", "omega")):
        np.testing.assert_array_equal(lines(draw_over_time, driven, what)[0]["command"].get_ydata(), driven.command[:, at])
    driven.estimate[:] = driven.true_state + np.array([0.3, -0.4, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(lines(draw_over_time, driven, "error")[0]["estimate"].get_ydata(), 0.5, atol=1e-12)


@pytest.mark.parametrize("turns", [2.0, -3.0])
def test_wrapping_leaves_no_jump(turns):
    driven = drive(turns=turns)
    assert np.abs(np.diff(driven.true_state[:, 2])).max() > 6.0  # it does wrap
    drawn, _ = lines(draw_over_time, driven, "theta")
    truth = drawn["truth"].get_ydata()
    assert np.abs(np.diff(truth)).max() < 0.2
    assert truth[-1] - truth[0] == pytest.approx(2.0 * np.pi * turns)
    for label in ("estimate", "odometry"):
        assert np.abs(drawn[label].get_ydata() - truth).max() < 1.0


def test_the_figure_of_a_drive_is_labelled_and_its_legend_hides_nothing_and_names_each_series_once():
    figure = tutorial_figure(drive(), title="A drive")
    assert all(HAS_UNIT.match(label) for axes in figure.axes for label in (axes.get_xlabel(), axes.get_ylabel()))
    assert figure.get_suptitle() == "A drive"
    figure.draw_without_rendering()
    (legend,) = figure.legends
    names = [text.get_text() for text in legend.get_texts()]
    assert sorted(names) == sorted([*SERIES, "reference", "command"])
    box = legend.get_window_extent()
    assert not any(box.overlaps(axes.get_tightbbox()) for axes in figure.axes)
    tutorial_figure(drive()[:1]).draw_without_rendering()
