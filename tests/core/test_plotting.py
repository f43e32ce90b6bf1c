"""Plots: what they draw is what happened, headings do not jump, and every axis names its unit."""

import math
import re
import subprocess
import sys

import matplotlib.colors
import numpy as np
import pytest
from matplotlib.figure import Figure

from turtlebot_gym.drives import Drive
from turtlebot_gym.plotting import (
    ESTIMATE_WITHIN,
    comparison_figure,
    draw_command,
    draw_component,
    draw_heading_error,
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


def axes():
    return Figure().subplots()


def line(drawn, label):
    return next(line for line in drawn.lines if line.get_label() == label)


@pytest.mark.parametrize(
    ("covariance", "sides"),
    [
        (np.diag([0.04, 0.01]), (0.4, 0.2)),
        (np.diag([0.0, 0.09, 1.0, 1.0, 1.0]), (0.0, 0.6)),
        (np.zeros((2, 2)), (0.0, 0.0)),
    ],
)
def test_ellipse_has_two_deviations_along_each_axis(covariance, sides):
    outline = ellipse((1.0, 2.0, 3.0), covariance)
    np.testing.assert_allclose(np.abs(outline - [1.0, 2.0]).max(0), sides, atol=1e-12)
    np.testing.assert_allclose(outline[0], outline[-1], atol=1e-12)


@pytest.mark.parametrize(("xx", "xy", "yy"), [(0.05, 0.03, 0.04), (0.01, -0.02, 0.09), (0.09, 0.02, 0.01)])
def test_ellipse_is_where_the_normalized_distance_is_the_number_of_sigmas(xx, xy, yy):
    covariance = np.array([[xx, xy], [xy, yy]])
    away = ellipse((0.3, -0.2), covariance, sigmas=3.0) - [0.3, -0.2]
    np.testing.assert_allclose(np.einsum("ni,ij,nj->n", away, np.linalg.inv(covariance), away), 9.0)


def test_trajectory_shows_truth_estimate_and_every_measurement():
    flown = drive()
    drawn = axes()
    assert draw_trajectory(drawn, flown) is drawn
    for label, pose in (("truth", flown.true_state), ("estimate", flown.estimate), ("odometry", flown.odometry)):
        np.testing.assert_array_equal(line(drawn, label).get_xydata(), pose[:, :2])
    assert drawn.get_aspect() == 1.0
    np.testing.assert_array_equal(line(drawn, "start").get_xydata(), flown.true_state[:1, :2])
    assert {tuple(point) for point in line(drawn, "waypoint").get_xydata()} == {(1.0, 0.0), (-1.0, 0.0)}


def test_a_legend_of_the_axes_names_each_series_once():
    drawn = draw_trajectory(axes(), drive())
    names = drawn.get_legend_handles_labels()[1]
    assert sorted(names) == sorted(["truth", "estimate", ESTIMATE_WITHIN, "odometry", "waypoint", "start"])


def test_ellipses_are_those_of_the_estimate_and_lie_in_the_view():
    flown = drive(samples=24)
    flown.covariance[:] = np.diag([4.0, 1.0, 0.0, 0.0, 0.0])
    drawn = draw_trajectory(axes(), flown, ellipses=12)
    (band,) = drawn.collections[:1]
    for at, outline in zip(range(0, 24, 2), band.get_paths(), strict=True):
        np.testing.assert_allclose(outline.vertices[:49], ellipse(flown.estimate[at], flown.covariance[at]))
    left, right = drawn.get_xlim()
    assert left < flown.estimate[0, 0] - 4.0 < flown.estimate[0, 0] + 4.0 < right


@pytest.mark.parametrize("shared", [{}, {"sharex": True}, {"sharey": True}, {"sharex": True, "sharey": True}])
def test_maps_may_share_their_axes(shared):
    figure = Figure()
    panels = figure.subplots(1, 2, **shared)
    for panel, turns in zip(panels, (0.2, 1.0), strict=True):
        draw_trajectory(panel, drive(turns=turns))
    figure.draw_without_rendering()
    for panel in panels:
        (x0, y0), (x1, y1) = panel.transData.transform([(0.0, 0.0), (1.0, 1.0)])
        assert x1 - x0 == pytest.approx(y1 - y0)  # a metre is as long in either direction
    if len(shared) == 2:
        assert panels[0].get_xlim() == panels[1].get_xlim()


def test_components_and_commands_are_what_was_recorded():
    flown = drive()
    for at, component in enumerate(("x", "y")):
        drawn = draw_component(axes(), flown, component)
        np.testing.assert_array_equal(line(drawn, "truth").get_ydata(), flown.true_state[:, at])
        np.testing.assert_array_equal(line(drawn, "odometry").get_ydata(), flown.odometry[:, at])
    for at, component in enumerate(("v", "omega")):
        drawn = draw_command(axes(), flown, component)
        np.testing.assert_array_equal(line(drawn, "command").get_ydata(), flown.command[:, at])


@pytest.mark.parametrize("turns", [2.0, -3.0])
def test_wrapping_leaves_no_jump(turns):
    flown = drive(turns=turns)
    assert np.abs(np.diff(flown.true_state[:, 2])).max() > 6.0  # it does wrap
    drawn = draw_component(axes(), flown, "theta")
    truth = line(drawn, "truth").get_ydata()
    assert np.abs(np.diff(truth)).max() < 0.2
    assert truth[-1] - truth[0] == pytest.approx(2.0 * np.pi * turns)
    for label in ("estimate", "odometry"):
        assert np.abs(line(drawn, label).get_ydata() - truth).max() < 1.0


def test_an_estimate_that_turns_the_wrong_way_round_is_interrupted():
    flown = drive(samples=400, turns=2.0)
    flown.estimate[:, 2] = 0.0  # a filter that is lost: its error goes through pi and on to -pi
    estimate = line(draw_component(axes(), flown, "theta"), "estimate").get_ydata()
    assert np.isnan(estimate).sum() == 2
    assert np.nanmax(np.abs(np.diff(estimate))) < np.pi


def test_errors_are_those_of_estimate_and_odometry():
    flown = drive()
    flown.estimate[:] = flown.true_state + np.array([0.3, -0.4, 0.0, 0.0, 0.0])
    flown.odometry[:] = flown.true_state[:, :3] + np.array([0.0, 0.0, 2.0 * np.pi - 0.1])
    position, heading = draw_position_error(axes(), flown), draw_heading_error(axes(), flown)
    np.testing.assert_allclose(line(position, "estimate").get_ydata(), 0.5)
    np.testing.assert_allclose(line(position, "odometry").get_ydata(), 0.0, atol=1e-12)
    np.testing.assert_allclose(line(heading, "odometry").get_ydata(), 0.1)


def test_a_map_is_drawn_where_it_lies():
    cells = np.array([[0, 100, -1], [0, 0, 0]], np.int8)
    figure = tutorial_figure(drive(), grid=GridMap(cells=cells, resolution=0.5, origin=Pose(1.0, 2.0, np.pi / 2.0)))
    (mesh,) = (each for each in figure.axes[0].collections if each.__class__.__name__ == "QuadMesh")
    corners = mesh.get_coordinates()  # a step along a row goes up, one to the next row goes to the left
    np.testing.assert_allclose(corners[[0, 0, 2], [0, 3, 0]], [(1.0, 2.0), (1.0, 3.5), (0.0, 2.0)], atol=1e-12)
    figure.draw_without_rendering()
    opaque, grey = mesh.get_facecolors()[:, 3].reshape(2, 3), mesh.get_facecolors()[:, 0].reshape(2, 3)
    np.testing.assert_array_equal(opaque, [[0.0, 1.0, 1.0], [0.0, 0.0, 0.0]])
    assert grey[0, 1] < grey[0, 2]  # what is not known is lighter than what is occupied


def test_tutorial_figure_is_complete_and_labelled():
    figure = tutorial_figure(drive(), title="A drive")
    labels = [(drawn.get_xlabel(), drawn.get_ylabel()) for drawn in figure.axes]
    assert [of_y for _, of_y in labels] == [
        "y (m)", "x (m)", "speed (m/s)", "y (m)", "turning rate (rad/s)", "heading (rad)", "position error (m)"
    ]  # fmt: skip
    assert all(HAS_UNIT.match(label) for pair in labels for label in pair)
    assert figure.get_suptitle() == "A drive"


def test_the_legend_hides_nothing_and_names_each_series_once():
    figure = tutorial_figure(drive())
    figure.draw_without_rendering()
    (legend,) = figure.legends
    names = [text.get_text() for text in legend.get_texts()]
    assert len(names) == len(set(names)) == 8
    box = legend.get_window_extent()
    assert not any(box.overlaps(drawn.get_tightbbox()) for drawn in figure.axes)
    assert box.x0 >= 0.0
    assert box.x1 <= figure.bbox.x1


@pytest.mark.parametrize("heading", [0.0, 0.5 * np.pi, np.pi, -0.5 * np.pi])
def test_a_waypoint_at_the_edge_shows_its_heading(heading):
    flown = drive()
    flown.reference[:] = [2.0, 2.0, heading]
    figure = comparison_figure([("policy", flown)])
    figure.draw_without_rendering()
    (drawn,) = figure.axes
    (left, right), (bottom, top) = drawn.get_xlim(), drawn.get_ylim()
    tip = np.array([2.0, 2.0]) + 0.2 * np.array([np.cos(heading), np.sin(heading)])
    assert left < tip[0] < right
    assert bottom < tip[1] < top


def test_series_without_data_are_not_in_the_legend():
    flown = drive()
    for part in (flown.true_state, flown.reference, flown.covariance):
        part[:] = np.nan
    figure = tutorial_figure(flown)
    figure.draw_without_rendering()
    names = {text.get_text() for text in figure.legends[0].get_texts()}
    assert {"truth", "waypoint", "reference", ESTIMATE_WITHIN}.isdisjoint(names)
    assert names == {"estimate", "odometry", "start", "command"}
    heading = line(figure.axes[5], "estimate").get_ydata()
    assert np.abs(np.diff(heading)).max() < 1.0


def test_comparison_tells_the_drives_apart_in_colour_and_in_print():
    drives = [(f"policy {at}", drive(seed=at, turns=0.2 * (at + 1))) for at in range(4)]
    figure = comparison_figure(drives)
    (drawn,) = figure.axes
    paths = [line(drawn, label) for label, _ in drives]
    for path, (_, flown) in zip(paths, drives, strict=True):
        np.testing.assert_array_equal(path.get_xydata(), flown.true_state[:, :2])
    assert len({matplotlib.colors.to_hex(path.get_color()) for path in paths}) == 4
    assert len({path.get_linestyle() for path in paths[:3]}) == 3
    assert HAS_UNIT.match(drawn.get_xlabel())
    assert HAS_UNIT.match(drawn.get_ylabel())


def test_runs_of_a_policy_share_a_colour_and_no_two_runs_look_alike():
    names = [f"{policy}, {noise}" for policy in "abcdef" for noise in ("tutorial", "documented", "wheel")]
    (drawn,) = comparison_figure([(name, drive()) for name in names]).axes
    looks = {name: (line(drawn, name).get_color(), line(drawn, name).get_linestyle()) for name in names}
    styles = {name: str(line(drawn, name)._dash_pattern) for name in names}
    assert {color for name, (color, _) in looks.items() if name.startswith("a")} == {looks["a, wheel"][0]}
    assert len({color for color, _ in looks.values()}) == 6
    assert len({(looks[name][0], styles[name]) for name in names}) == len(names)


def test_the_end_of_a_drive_is_in_the_legend():
    figure = comparison_figure([("policy", drive())])
    assert "end" in {text.get_text() for text in figure.legends[0].get_texts()}


def test_series_differ_in_lightness_too():
    drawn = draw_component(axes(), drive(), "x")
    grey = [
        float(np.dot(matplotlib.colors.to_rgb(line(drawn, label).get_color()), (0.299, 0.587, 0.114)))
        for label in ("truth", "estimate", "odometry")
    ]
    assert min(abs(a - b) for at, a in enumerate(grey) for b in grey[:at]) > 0.1


def test_a_figure_needs_no_display_and_leaves_no_global_state(tmp_path):
    path = tmp_path / "drive.png"
    tutorial_figure(drive()).savefig(path)
    assert path.read_bytes().startswith(b"\x89PNG")
    code = """
import sys
import numpy as np
from turtlebot_gym.plotting import tutorial_figure
from turtlebot_gym.drives import Drive
assert "matplotlib" not in sys.modules
tutorial_figure(Drive.stack([{"true_state": np.zeros(5), "odometry": np.zeros(3), "estimate": np.zeros(5),
    "covariance": np.zeros((5, 5)), "reference": np.zeros(3), "command": np.zeros(2)}] * 2, time=np.arange(2.0)))
assert "matplotlib.pyplot" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_single_sample_can_be_drawn():
    short = drive()[:1]
    tutorial_figure(short).draw_without_rendering()
    assert math.isfinite(short.time[0])
