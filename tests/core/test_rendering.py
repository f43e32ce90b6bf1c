"""Pictures of the environment: things are drawn where they are, trails end with the episode, and no display is needed."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from gymnasium.error import DependencyNotInstalled

from turtlebot_gym.envs.rendering import HEADER, SIDE, Renderer
from turtlebot_gym.estimation.ekf import Estimate
from turtlebot_gym.robots import ROBOTS
from turtlebot_gym.systems import Body, Course, Snapshot
from turtlebot_gym.tasks import NAV, POSE, SQUARE, SQUARE_WAYPOINTS
from turtlebot_gym.values import STOP, Belief, Covariance, Odometry, Pose, Senses, State

PALE_GREEN = (153, 216, 199)
BODY, GREEN, BLACK, VERMILLION, SKY_BLUE = (200, 200, 200), (0, 158, 115), (0, 0, 0), (213, 94, 0), (86, 180, 233)
FAR = Pose(-1.8, -1.8, 0.0)


def world(truth=FAR, *, believed=FAR, odometry=FAR, reference=FAR, deviation=0.05, steps=0.0) -> Snapshot:
    """Return a world with everything at its place, and all else in a corner."""
    variance = deviation**2
    covariance = Covariance(variance, 0.0, 0.0, 0.0, 0.0, variance, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0, 0.0, 0.0)
    return Snapshot(
        Body(State(*truth, 0.0, 0.0), STOP, (STOP, STOP, STOP), Pose(*truth), False),
        Senses(Odometry(odometry, STOP, True)),
        Estimate(Belief(State(*believed, 0.0, 0.0), covariance), 0.0, 0.0),
        Course(reference, reference, 0.0),
        steps,
    )


def make(mode="rgb_array", *, waypoints=None, **options):
    task = SQUARE if waypoints else NAV
    return Renderer(mode, **{"robot": ROBOTS["burger"], "task": task, "waypoints": waypoints, "dt": 0.1, "fps": 10, **options})


def pixel(picture, x, y, *, centre=0.0, half=2.5):
    """Return the colour at a point of the world: the view is the arena, or the square, and 0.5 m round it."""
    row = HEADER + (centre + half - y) / (2.0 * half) * SIDE
    column = (x - centre + half) / (2.0 * half) * SIDE
    return tuple(picture[int(row), int(column)])


def count(picture, color):
    return int((np.abs(picture[HEADER:].astype(int) - color).max(-1) < 12).sum())


def test_picture_is_an_array_that_owns_its_pixels():
    renderer = make()
    first = renderer.draw(world())
    kept = first.copy()
    second = renderer.draw(world(Pose(1.0, 1.0, 0.0)))
    for picture in (first, second):
        assert picture.shape == (HEADER + SIDE, SIDE, 3)
        assert picture.dtype == np.uint8
        assert picture.flags.c_contiguous
    np.testing.assert_array_equal(first, kept)
    assert (first != second).any()


@pytest.mark.parametrize(("x", "y"), [(0.0, 0.0), (1.5, -0.5), (-1.0, 1.9)])
def test_robot_is_drawn_where_it_is(x, y):
    heading = 0.7
    picture = make().draw(world(Pose(x, y, heading)))
    half_radius = 0.5 * ROBOTS["burger"].radius
    ahead = pixel(picture, x + half_radius * np.cos(heading), y + half_radius * np.sin(heading))
    behind = pixel(picture, x - half_radius * np.cos(heading), y - half_radius * np.sin(heading))
    assert ahead == BLACK
    assert behind == BODY
    assert pixel(picture, x + 0.3, y) not in (BLACK, BODY)


def test_robot_is_drawn_in_its_size():
    sizes = [count(make(robot=ROBOTS[name]).draw(world(Pose(0.0, 0.0, 0.0))), BODY) for name in ("burger", "waffle")]
    assert sizes[1] > 2 * sizes[0]


def test_the_square_fills_the_view():
    for corner in SQUARE_WAYPOINTS:
        picture = make(waypoints=SQUARE_WAYPOINTS).draw(world(corner, reference=Pose(1.0, 1.0, 0.0)))
        behind = corner.x - 0.05 * np.cos(corner.theta), corner.y - 0.05 * np.sin(corner.theta)
        assert pixel(picture, *behind, centre=1.0, half=1.5) == BODY


def test_coordinates_at_the_edge_are_left_out_instead_of_cut_off():
    """Of a view from -4.25 to 4.25 m, where the labels of -4 m of both axes would meet in the corner."""
    picture = make(task=replace(NAV, arena=3.75)).draw(world())
    assert picture[-34:, :34].min() > 220  # white, and lines of the grid
    assert picture[-20:, 60:].min() < 150
    assert picture[HEADER + 60 : -60, :30].min() < 150


def test_the_current_waypoint_stands_out_among_all():
    pictures = [make(waypoints=SQUARE_WAYPOINTS).draw(world(Pose(1.0, 1.0, 0.0), reference=at)) for at in SQUARE_WAYPOINTS]
    for picture, current in zip(pictures, SQUARE_WAYPOINTS, strict=True):
        for waypoint in SQUARE_WAYPOINTS:
            on_heading = waypoint.x + 0.15 * np.cos(waypoint.theta), waypoint.y + 0.15 * np.sin(waypoint.theta)
            color = pixel(picture, *on_heading, centre=1.0, half=1.5)
            assert (color == GREEN) == (waypoint is current)
            assert max(color) - min(color) > 30  # the others are there too, paler


def test_the_goal_has_the_radius_of_arrival():
    picture = make().draw(world(reference=Pose(1.0, 1.0, 0.0)))
    inside = NAV.radius - 0.01
    assert pixel(picture, 1.0, 1.0 + inside) == pixel(picture, 1.0, 1.0 - inside) == GREEN
    assert pixel(picture, 1.0, 1.0 + NAV.radius + 0.05) != GREEN


@pytest.mark.parametrize("heading", [0.0, 2.0])
def test_a_goal_pose_shows_the_headings_that_count(heading):
    goal = Pose(0.5, 0.5, heading)
    point, pose = (make(task=task).draw(world(reference=goal)) for task in (NAV, POSE))

    def beyond(picture, off):
        return pixel(picture, 0.5 + 0.35 * np.cos(heading + off), 0.5 + 0.35 * np.sin(heading + off))

    inside, outside = 0.8 * POSE.heading_tolerance, 1.3 * POSE.heading_tolerance
    assert {beyond(pose, off) for off in (-inside, 0.0, inside)} == {PALE_GREEN}
    assert PALE_GREEN not in {beyond(pose, off) for off in (-outside, outside)}
    assert PALE_GREEN not in {beyond(point, off) for off in (-inside, 0.0, inside)}


@pytest.mark.parametrize("scale", [2.0, 4.0])
def test_ellipse_grows_with_the_deviation(scale):
    def extent(deviation):
        picture = make().draw(world(believed=Pose(0.0, 0.0, 0.0), deviation=deviation))
        rows, columns = np.nonzero(np.abs(picture[HEADER:].astype(int) - VERMILLION).max(-1) < 12)
        return np.ptp(rows), np.ptp(columns)

    per_metre = SIDE / 5.0
    for size in (0.1, 0.1 * scale):
        np.testing.assert_allclose(extent(size), 4.0 * size * per_metre, atol=4)


def test_trails_grow_and_reset_forgets_them():
    renderer = make()
    start = renderer.draw(world(Pose(-1.0, 0.5, 0.0)))
    for x in np.linspace(-1.0, 1.0, 20):
        last = renderer.draw(world(Pose(x, 0.5, 0.0), believed=Pose(x, -0.5, 0.0), odometry=Pose(x, -1.0, 0.0)))
    assert pixel(last, 0.025, 0.5) == BLACK
    assert pixel(last, 0.025, -0.5) == VERMILLION
    renderer.reset()
    np.testing.assert_array_equal(renderer.draw(world(Pose(-1.0, 0.5, 0.0))), start)


def test_odometry_stays_as_dots():
    renderer = make()
    for x in (-1.0, 0.05, 1.05):
        picture = renderer.draw(world(odometry=Pose(x, 1.55, 0.0)))
    assert pixel(picture, 0.05, 1.55) == pixel(picture, 1.05, 1.55) == SKY_BLUE
    assert pixel(picture, 0.55, 1.55) == (255, 255, 255)


def test_the_latest_odometry_stands_out_and_shows_its_heading():
    renderer = make()
    heading = 2.0
    tip = 0.9 * ROBOTS["burger"].radius * np.array([np.cos(heading), np.sin(heading)])
    latest = renderer.draw(world(odometry=Pose(0.05, 1.55, heading)))
    past = renderer.draw(world(odometry=Pose(1.05, 1.55, heading)))
    for x, picture, shown in ((0.05, latest, True), (1.05, past, True), (0.05, past, False)):
        assert (pixel(picture, x + tip[0], 1.55 + tip[1]) == SKY_BLUE) == shown
        assert pixel(picture, x, 1.55) == SKY_BLUE


def test_a_robot_that_drives_away_stays_in_view_with_its_trail():
    renderer = make(robot=replace(ROBOTS["burger"], radius=0.5))
    for x in np.linspace(0.0, 9.0, 40):
        picture = renderer.draw(world(Pose(x, 0.5, 0.0)))
        half = next(half for half in (2.5 * 1.25**step for step in range(9)) if x + 0.5 <= half)
        assert pixel(picture, x - 0.15, 0.5, half=half) == BODY
        assert pixel(picture, x / 2.0, 0.5, half=half) == BLACK or x < 1.1  # a shorter trail is under the robot
    renderer.reset()
    assert pixel(renderer.draw(world(Pose(1.0, 0.5, np.pi))), 1.15, 0.5) == BODY


def test_nothing_outside_the_map_covers_the_legend():
    renderer, other = make(), make()
    above = Pose(0.0, 2.6, 0.0)
    strips = [r.draw(world(believed=at, odometry=at))[:HEADER] for r, at in ((renderer, above), (other, FAR))]
    np.testing.assert_array_equal(*strips)


def test_the_time_is_shown():
    renderer = make()
    early, late = (renderer.draw(world(steps=steps)) for steps in (0.0, 123.0))
    assert (early[:HEADER] != late[:HEADER]).any()
    np.testing.assert_array_equal(early[HEADER:], late[HEADER:])


def test_window_shows_the_picture_and_closes(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    import pygame

    renderer = make("human", fps=1000)
    now = world(Pose(0.5, 0.5, 0.0))
    assert renderer.draw(now) is None
    shown = pygame.surfarray.array3d(pygame.display.get_surface()).transpose(1, 0, 2)
    np.testing.assert_array_equal(shown, make().draw(now))
    renderer.close()
    assert not pygame.display.get_init()
    renderer.close()


def test_arrays_open_no_display():
    import pygame

    renderer = make()
    renderer.draw(world())
    assert not pygame.display.get_init()
    renderer.close()


def test_missing_pygame_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(DependencyNotInstalled, match="pip install"):
        make()
