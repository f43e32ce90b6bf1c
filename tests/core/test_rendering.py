"""Pictures of the environment: things are drawn where they are, trails end with the episode, and no display is needed."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from gymnasium.error import DependencyNotInstalled

from turtlebot_gym import make_parameters
from turtlebot_gym.envs.rendering import HEADER, SIDE, Renderer
from turtlebot_gym.estimation.ekf import Estimate
from turtlebot_gym.robots import ROBOTS
from turtlebot_gym.systems import Body, Course, Snapshot
from turtlebot_gym.tasks import NAV, POSE, SQUARE, SQUARE_WAYPOINTS
from turtlebot_gym.values import STOP, Belief, Covariance, Odometry, Pose, Senses, State

PALE_GREEN, WHITE = (153, 216, 199), (255, 255, 255)
BODY, GREEN, BLACK, VERMILLION, SKY_BLUE = (200, 200, 200), (0, 158, 115), (0, 0, 0), (213, 94, 0), (86, 180, 233)
FAR = Pose(-1.8, -1.8, 0.0)
RADIUS = ROBOTS["burger"].radius


def world(truth=FAR, *, believed=FAR, odometry=FAR, reference=FAR, deviation=0.05, steps=0.0) -> Snapshot:
    """Return a world with everything at its place, and all else in a corner."""
    covariance = Covariance(*[0.0] * 8)._replace(xx=deviation**2, yy=deviation**2, tt=0.01)
    return Snapshot(
        Body(State(*truth, 0.0, 0.0), STOP, (STOP, STOP, STOP), Pose(*truth), False),
        Senses(Odometry(odometry, STOP, True)),
        Estimate(Belief(State(*believed, 0.0, 0.0), covariance), 0.0, 0.0),
        Course(reference, reference, 0.0),
        steps,
    )


def make(*, windows=False, waypoints=(), **options):
    parameters = make_parameters()._replace(**{"task": SQUARE if waypoints else NAV, **options})
    return Renderer(parameters, windows=windows, waypoints=waypoints, fps=1000)


def pixel(picture, x, y, *, centre=0.0, half=2.5, ahead=0.0, heading=0.0):
    """Return the colour at a point of the world, or so far ahead of it; the view is the arena and 0.5 m round it."""
    x, y = x + ahead * np.cos(heading), y + ahead * np.sin(heading)
    row = HEADER + (centre + half - y) / (2.0 * half) * SIDE
    column = (x - centre + half) / (2.0 * half) * SIDE
    return tuple(picture[int(row), int(column)])


def places_of(picture, color):
    return np.nonzero(np.abs(picture[HEADER:].astype(int) - color).max(-1) < 12)


def test_picture_is_an_array_that_owns_its_pixels_and_opens_no_display():
    import pygame

    renderer = make()
    first = renderer.draw(world())
    kept = first.copy()
    second = renderer.draw(world(Pose(1.0, 1.0, 0.0)))
    for picture in (first, second):
        assert (picture.shape, picture.dtype) == ((HEADER + SIDE, SIDE, 3), np.uint8)
        assert picture.flags.c_contiguous
    np.testing.assert_array_equal(first, kept)
    assert (first != second).any()
    assert not pygame.display.get_init()


@pytest.mark.parametrize(("x", "y"), [(0.0, 0.0), (1.5, -0.5), (-1.0, 1.9)])
def test_robot_is_drawn_where_it_is(x, y):
    picture = make().draw(world(Pose(x, y, 0.7)))
    colors = [pixel(picture, x, y, ahead=ahead, heading=0.7) for ahead in (0.5 * RADIUS, -0.5 * RADIUS)]
    assert colors == [BLACK, BODY]
    assert pixel(picture, x + 0.3, y) not in (BLACK, BODY)


@pytest.mark.parametrize("current", SQUARE_WAYPOINTS)
def test_the_square_fills_the_view_and_its_current_waypoint_stands_out(current):
    view = {"centre": 1.0, "half": 1.5}
    at_corner = make(waypoints=SQUARE_WAYPOINTS).draw(world(current, reference=Pose(1.0, 1.0, 0.0)))
    assert pixel(at_corner, current.x, current.y, ahead=-0.05, heading=current.theta, **view) == BODY
    picture = make(waypoints=SQUARE_WAYPOINTS).draw(world(Pose(1.0, 1.0, 0.0), reference=current))
    for x, y, theta in SQUARE_WAYPOINTS:
        color = pixel(picture, x, y, ahead=0.15, heading=theta, **view)
        assert (color == GREEN) == ((x, y, theta) == current)
        assert max(color) - min(color) > 30  # the others are there too, paler


@pytest.mark.parametrize("heading", [0.0, 2.0])
def test_a_goal_pose_shows_the_headings_that_count(heading):
    point, pose = (make(task=task).draw(world(reference=Pose(0.5, 0.5, heading))) for task in (NAV, POSE))

    def beyond(picture, *shares):
        turns = [heading + share * POSE.heading_tolerance for share in shares]
        return {pixel(picture, 0.5, 0.5, ahead=0.35, heading=turn) for turn in turns}

    assert beyond(pose, -0.8, 0.0, 0.8) == {PALE_GREEN}
    assert PALE_GREEN not in beyond(pose, -1.3, 1.3) | beyond(point, -0.8, 0.0, 0.8)


@pytest.mark.parametrize("deviation", [0.1, 0.2, 0.4])
def test_ellipse_grows_with_the_deviation(deviation):
    rows, columns = places_of(make().draw(world(believed=Pose(0.0, 0.0, 0.0), deviation=deviation)), VERMILLION)
    np.testing.assert_allclose((np.ptp(rows), np.ptp(columns)), 4.0 * deviation * SIDE / 5.0, atol=4)


def test_trails_grow_and_reset_forgets_them():
    renderer = make()
    start = renderer.draw(world(Pose(-1.0, 0.5, 0.0)))
    for x in np.linspace(-1.0, 1.0, 20):
        last = renderer.draw(world(Pose(x, 0.5, 0.0), believed=Pose(x, -0.5, 0.0), odometry=Pose(x, -1.0, 0.0)))
    assert pixel(last, 0.025, 0.5) == BLACK
    assert pixel(last, 0.025, -0.5) == VERMILLION
    renderer.reset()
    np.testing.assert_array_equal(renderer.draw(world(Pose(-1.0, 0.5, 0.0))), start)


def test_a_robot_that_drives_away_stays_in_view_with_its_trail():
    renderer = make(robot=replace(ROBOTS["burger"], radius=0.5))
    for x in np.linspace(0.0, 9.0, 40):
        picture = renderer.draw(world(Pose(x, 0.5, 0.0)))
        half = next(half for half in (2.5 * 1.25**step for step in range(9)) if x + 0.5 <= half)
        assert pixel(picture, x - 0.15, 0.5, half=half) == BODY
        assert pixel(picture, x / 2.0, 0.5, half=half) == BLACK or x < 1.1  # a shorter trail is under the robot
    renderer.reset()
    assert pixel(renderer.draw(world(Pose(1.0, 0.5, np.pi))), 1.15, 0.5) == BODY


def test_window_shows_the_picture_and_closes(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    import pygame

    renderer = make(windows=True)
    now = world(Pose(0.5, 0.5, 0.0))
    assert renderer.draw(now) is None
    shown = pygame.surfarray.array3d(pygame.display.get_surface()).transpose(1, 0, 2)
    np.testing.assert_array_equal(shown, make().draw(now))
    renderer.close()
    assert not pygame.display.get_init()
    renderer.close()


def test_missing_pygame_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(DependencyNotInstalled, match="pip install"):
        make()
