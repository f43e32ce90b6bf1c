"""Plots: what they draw is what happened, headings do not jump, and every axis names its unit."""

import re

import matplotlib.colors
import numpy as np
import pytest
from matplotlib.figure import Figure

from turtlebot_gym.drive import Drive
from turtlebot_gym.plotting import (
    ESTIMATE_WITHIN,
    comparison_figure,
    draw_command,
    draw_component,
    draw_position_error,
    draw_trajectory,
    ellipse,
    tutorial_figure,
)
from turtlebot_gym.rooms.grid import GridMap
from turtlebot_gym.values import Pose

HAS_UNIT = re.compile(r".+ \((m|s|rad|m/s|rad/s)\)$")


def drive(*, samples: int = 200, turns: float = 2.0, deviation: float = 0.1, seed: int = 0) -> Drive:
    """Return a drive round a circle of 1 m: so many turns, with headings in [-pi, pi)."""
    rng = np.random.default_rng(seed)
    time = 0.1 * np.arange(samples)
    heading = np.linspace(0.0, 2.0 * np.pi * turns, samples)
    truth = np.stack([np.sin(heading), -np.cos(heading), heading, 0.0 * time + 0.2, 0.0 * time + 0.2], axis=-1)
    odometry = truth[:, :3] + deviation * rng.standard_normal((samples, 3))
    estimate = truth + 0.2 * deviation * rng.standard_normal((samples, 5))
    for pose in (truth, odometry, estimate):
        pose[:, 2] = (pose[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
    return Drive(
        time=time,
        true_state=truth,
        odometry=odometry,
        estimate=estimate,
        covariance=np.tile((0.2 * deviation) ** 2 * np.eye(5), (samples, 1, 1)),
        reference=np.repeat([[1.0, 0.0, 0.5], [-1.0, 0.0, 3.1]], samples // 2, axis=0),
        command=truth[:, 3:].copy(),
    )


def drawn(draw, *arguments, **options):
    """Return axes into which a function has drawn."""
    axes = Figure().subplots()
    assert draw(axes, *arguments, **options) is axes
    return axes


def line(axes, label):
    return next(line for line in axes.lines if line.get_label() == label)


@pytest.mark.parametrize(("xx", "xy", "yy"), [(0.05, 0.03, 0.04), (0.01, -0.02, 0.09), (0.09, 0.02, 0.01)])
def test_ellipse_is_where_the_normalized_distance_is_the_number_of_sigmas(xx, xy, yy):
    covariance = np.array([[xx, xy], [xy, yy]])
    away = ellipse((0.3, -0.2), covariance, sigmas=3.0) - [0.3, -0.2]
    np.testing.assert_allclose(np.einsum("ni,ij,nj->n", away, np.linalg.inv(covariance), away), 9.0)


def test_trajectory_shows_truth_estimate_and_every_measurement_and_names_each_once():
    driven = drive()
    axes = drawn(draw_trajectory, driven)
    for label, pose in (("truth", driven.true_state), ("estimate", driven.estimate), ("odometry", driven.odometry)):
        np.testing.assert_array_equal(line(axes, label).get_xydata(), pose[:, :2])
    assert axes.get_aspect() == 1.0
    np.testing.assert_array_equal(line(axes, "start").get_xydata(), driven.true_state[:1, :2])
    assert {tuple(point) for point in line(axes, "waypoint").get_xydata()} == {(1.0, 0.0), (-1.0, 0.0)}
    names = axes.get_legend_handles_labels()[1]
    assert sorted(names) == sorted(["truth", "estimate", ESTIMATE_WITHIN, "odometry", "waypoint", "start"])


def test_components_and_commands_are_what_was_recorded_and_differ_in_lightness_too():
    driven = drive()
    for at, component in enumerate(("x", "y")):
        axes = drawn(draw_component, driven, component)
        np.testing.assert_array_equal(line(axes, "truth").get_ydata(), driven.true_state[:, at])
        np.testing.assert_array_equal(line(axes, "odometry").get_ydata(), driven.odometry[:, at])
    colors = [matplotlib.colors.to_rgb(line(axes, label).get_color()) for label in ("truth", "estimate", "odometry")]
    assert np.diff(sorted(np.dot(colors, (0.299, 0.587, 0.114)))).min() > 0.1
    for at, component in enumerate(("v", "omega")):
        shown = line(drawn(draw_command, driven, component), "command").get_ydata()
        np.testing.assert_array_equal(shown, driven.command[:, at])


@pytest.mark.parametrize("turns", [2.0, -3.0])
def test_wrapping_leaves_no_jump(turns):
    driven = drive(turns=turns)
    assert np.abs(np.diff(driven.true_state[:, 2])).max() > 6.0  # it does wrap
    axes = drawn(draw_component, driven, "theta")
    truth = line(axes, "truth").get_ydata()
    assert np.abs(np.diff(truth)).max() < 0.2
    assert truth[-1] - truth[0] == pytest.approx(2.0 * np.pi * turns)
    for label in ("estimate", "odometry"):
        assert np.abs(line(axes, label).get_ydata() - truth).max() < 1.0


def test_errors_are_those_of_estimate_and_odometry():
    driven = drive()
    driven.estimate[:] = driven.true_state + np.array([0.3, -0.4, 0.0, 0.0, 0.0])
    for draw, label, error in ((draw_position_error, "estimate", 0.5),):
        np.testing.assert_allclose(line(drawn(draw, driven), label).get_ydata(), error, atol=1e-12)


def test_a_map_is_drawn_where_it_lies():
    cells = np.array([[0, 100, -1], [0, 0, 0]], np.int8)
    figure = tutorial_figure(drive(), grid=GridMap(cells=cells, resolution=0.5, origin=Pose(1.0, 2.0, np.pi / 2.0)))
    (mesh,) = (artist for artist in figure.axes[0].collections if artist.__class__.__name__ == "QuadMesh")
    corners = mesh.get_coordinates()  # a step along a row goes up, one to the next row goes to the left
    np.testing.assert_allclose(corners[[0, 0, 2], [0, 3, 0]], [(1.0, 2.0), (1.0, 3.5), (0.0, 2.0)], atol=1e-12)
    figure.draw_without_rendering()
    opaque, grey = mesh.get_facecolors()[:, 3].reshape(2, 3), mesh.get_facecolors()[:, 0].reshape(2, 3)
    np.testing.assert_array_equal(opaque, [[0.0, 1.0, 1.0], [0.0, 0.0, 0.0]])
    assert grey[0, 1] < grey[0, 2]  # what is not known is lighter than what is occupied


def test_tutorial_figure_is_labelled_and_its_legend_hides_nothing_and_names_each_series_once():
    figure = tutorial_figure(drive(), title="A drive")
    labels = [(axes.get_xlabel(), axes.get_ylabel()) for axes in figure.axes]
    assert [of_y for _, of_y in labels] == [
        "y (m)",
        "x (m)",
        "speed (m/s)",
        "y (m)",
        "turning rate (rad/s)",
        "heading (rad)",
        "position error (m)",
    ]
    assert all(HAS_UNIT.match(label) for pair in labels for label in pair)
    assert figure.get_suptitle() == "A drive"
    figure.draw_without_rendering()
    (legend,) = figure.legends
    names = [text.get_text() for text in legend.get_texts()]
    assert len(names) == len(set(names)) == 8
    box = legend.get_window_extent()
    assert not any(box.overlaps(axes.get_tightbbox()) for axes in figure.axes)
    assert 0.0 <= box.x0 < box.x1 <= figure.bbox.x1


def test_comparison_shows_each_drive_with_its_end_and_no_two_runs_look_alike():
    names = [f"{policy}, {noise}" for policy in "abcdef" for noise in ("tutorial", "documented", "wheel")]
    drives = [(name, drive(seed=at, turns=0.1 * (at + 1))) for at, name in enumerate(names)]
    figure = comparison_figure(drives)
    (axes,) = figure.axes
    for name, driven in drives:
        np.testing.assert_array_equal(line(axes, name).get_xydata(), driven.true_state[:, :2])
    colors = {name: matplotlib.colors.to_hex(line(axes, name).get_color()) for name in names}
    assert len(set(colors.values())) == 6
    assert len({color for name, color in colors.items() if name.startswith("a")}) == 1  # runs of a policy share a colour
    assert len({(colors[name], str(line(axes, name)._dash_pattern)) for name in names}) == len(names)
    assert len({line(axes, name).get_linestyle() for name in names[::3][:3]}) == 3  # policies differ in print as well
    assert HAS_UNIT.match(axes.get_xlabel())
    assert HAS_UNIT.match(axes.get_ylabel())
    assert "end" in {text.get_text() for text in figure.legends[0].get_texts()}


CODE = """
import json, sys
import numpy as np
from turtlebot_gym.plotting import tutorial_figure
from turtlebot_gym.drive import Drive
before = "matplotlib" in sys.modules
sizes = {"true_state": 5, "odometry": 3, "estimate": 5, "covariance": (5, 5), "reference": 3, "command": 2}
rows = [{name: np.zeros(size) for name, size in sizes.items()}] * 2
tutorial_figure(Drive.stack(rows, time=np.arange(2.0))).savefig(sys.argv[1])
print(json.dumps([before, "matplotlib.pyplot" in sys.modules]))
"""


def test_a_figure_needs_no_display_and_leaves_no_global_state_and_a_single_sample_can_be_drawn(tmp_path, run):
    assert run(CODE, tmp_path / "drive.png") == [False, False]
    assert (tmp_path / "drive.png").read_bytes().startswith(b"\x89PNG")
    tutorial_figure(drive()[:1]).draw_without_rendering()
