"""Pictures of the environment: things are drawn where they are, trails end with the episode, and no display is needed."""

from dataclasses import replace

import numpy as np
import pytest

from turtlebot_gym import Episode, Robot, make_parameters
from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.envs.rendering import HEADER, SIDE, Renderer
from turtlebot_gym.robots import ROBOTS
from turtlebot_gym.tasks import NAV
from turtlebot_gym.values import Covariance, Pose, State

BODY, BLACK, VERMILLION = (200, 200, 200), (0, 0, 0), (213, 94, 0)
FAR = Pose(-1.8, -1.8, 0.0)
BURGER: Robot = ROBOTS["burger"]
BASE = Episode(make_parameters()).world


def world(truth, *, believed=FAR):
    """Return a world with everything at its place, and all else in a corner."""
    belief = BASE.estimate.belief._replace(mean=State(*believed, 0.0, 0.0), covariance=Covariance(*[0.0] * 8))
    return BASE._replace(
        body=BASE.body._replace(true_state=State(*truth, 0.0, 0.0)),
        senses=BASE.senses._replace(odometry=BASE.senses.odometry._replace(pose=FAR)),
        estimate=BASE.estimate._replace(belief=belief),
        course=BASE.course._replace(reference=FAR),
    )


def make(**options):
    return Renderer(Batch(1, make_parameters()._replace(**{"task": NAV, **options}), ()))


def pixel(picture, x, y, *, half=2.5, ahead=0.0, heading=0.0):
    """Return the colour at a point of the world, or so far ahead of it; the view is the arena and 0.5 m round it."""
    x, y = x + ahead * np.cos(heading), y + ahead * np.sin(heading)
    return tuple(picture[int(HEADER + (half - y) / (2.0 * half) * SIDE), int((x + half) / (2.0 * half) * SIDE)])


@pytest.mark.parametrize(("x", "y"), [(0.0, 0.0), (1.5, -0.5), (-1.0, 1.9)])
def test_robot_is_drawn_where_it_is_into_an_array_of_the_callers_own(x, y):
    renderer = make()
    picture = renderer.draw(world(Pose(x, y, 0.7)))
    colors = [pixel(picture, x, y, ahead=ahead, heading=0.7) for ahead in (0.5 * BURGER.radius, -0.5 * BURGER.radius)]
    assert colors == [BLACK, BODY]
    assert pixel(picture, x + 0.3, y) not in (BLACK, BODY)
    kept = picture.copy()
    renderer.draw(world(Pose(-x, 1.0, 0.0)))
    np.testing.assert_array_equal(picture, kept)
    assert (picture.shape, picture.dtype) == ((HEADER + SIDE, SIDE, 3), np.uint8)


def test_trails_grow_and_a_robot_that_drives_away_stays_in_view():
    renderer = make(robot=replace(BURGER, radius=0.5))
    start = renderer.draw(world(Pose(0.0, 0.5, 0.0)))
    for x in np.linspace(0.0, 9.0, 15):
        picture = renderer.draw(world(Pose(x, 0.5, 0.0), believed=Pose(x, -0.5, 0.0)))
        half = next(half for half in (2.5 * 1.25**step for step in range(9)) if x + 0.5 <= half)
        assert pixel(picture, x - 0.15, 0.5, half=half) == BODY
        for y, color in ((0.5, BLACK), (-0.5, VERMILLION)):  # a shorter trail is under the robot; one of the two has dashes
            seen = [pixel(picture, x / 2.0 + 0.02 * k, y, half=half) for k in range(-9, 9)]
            assert np.abs(np.array(seen, float) - color).max(1).min() < 100.0 or x < 1.1
    np.testing.assert_array_equal(make(robot=replace(BURGER, radius=0.5)).draw(world(Pose(0.0, 0.5, 0.0))), start)
