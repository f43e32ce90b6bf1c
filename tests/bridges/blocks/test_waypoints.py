"""The reference: what is published, and when it changes."""

import math

import pytest

from turtlebot_gym.estimation.ekf import Estimate
from turtlebot_gym.systems import Episode, Options, make_parameters
from turtlebot_gym.tasks import SQUARE_WAYPOINTS
from turtlebot_gym.values import STOP, Belief, Covariance, Pose, State
from turtlebot_gym_ros.blocks import WaypointGenerator
from turtlebot_gym_ros.blocks.waypoints import _load_waypoints


def generator(**parameters):
    return WaypointGenerator(WaypointGenerator.Params(**parameters))


def at(x, y, theta=0.0):
    return Estimate(Belief(State(x, y, theta, 0.0, 0.0), Covariance(*[0.0] * 15)), 0.0, 0.0)


def reference(node, estimate=None, goal=None):
    return node.step(0.1, estimate, goal)["reference"]


def test_it_speaks_before_anybody_is_there():
    out = generator().step(0.1, None, None)
    assert out == {"reference": SQUARE_WAYPOINTS[0], "following": SQUARE_WAYPOINTS[1]}


def test_waypoints_are_taken_in_order_on_arrival():
    node = generator()
    reference(node, at(SQUARE_WAYPOINTS[0].x, SQUARE_WAYPOINTS[0].y))  # an episode's first estimate is not judged
    for here, there in zip(SQUARE_WAYPOINTS, [*SQUARE_WAYPOINTS[1:], SQUARE_WAYPOINTS[-1]], strict=True):
        assert reference(node, at(here.x + 0.26, here.y)) == here
        assert reference(node) == here  # without an estimate nothing is reached
        assert reference(node, at(here.x + 0.24, here.y)) == there
    assert node.step(0.1, at(0.0, 0.0), None)["following"] == SQUARE_WAYPOINTS[-1]  # the last one stays


def test_by_time_it_switches_at_the_environments_steps():
    task, waypoints = Options(task="square", switch="time").course()
    episode, node = Episode(make_parameters(task), waypoints), generator(switch="time")
    for _ in range(30):
        assert reference(node) == SQUARE_WAYPOINTS[0]  # the time does not run before there is a robot
    for _ in range(600):
        out = node.step(0.1, at(0.0, 0.0), None)
        course = episode.world.course
        assert (out["reference"], out["following"]) == (course.reference, course.following)
        episode.step(STOP)


def test_by_time_a_lost_estimate_does_not_stop_the_clock():
    node = generator(switch="time", switch_period=1.0)
    reference(node, at(0.0, 0.0))
    seen = [reference(node) for _ in range(40)]
    assert [seen.index(waypoint) for waypoint in SQUARE_WAYPOINTS[1:]] == [9, 19, 29]


def test_laps():
    node = generator(laps=2)
    reference(node, at(0.0, 0.0))  # an episode's first estimate is not judged, as in the environment
    order = []
    for _ in range(20):
        waypoint = reference(node)
        order.append(waypoint)
        reference(node, at(waypoint.x, waypoint.y))
    assert order[:8] == [*SQUARE_WAYPOINTS, *SQUARE_WAYPOINTS]
    assert set(order[8:]) == {SQUARE_WAYPOINTS[-1]}


def test_waypoints_relative_to_the_start():
    node = generator(relative=True)
    assert node.step(0.1, None, None) == {}
    first = reference(node, at(1.0, 1.0, math.pi / 2))
    assert first == pytest.approx((1.0, 3.0, math.pi / 2))
    assert reference(node, at(0.0, 0.0)) == first  # the start counts, not the way
    node.reset()
    assert reference(node, at(0.0, 0.0)) == SQUARE_WAYPOINTS[0]


def test_a_pose_from_rviz_takes_the_place_of_all_waypoints():
    node, goal = generator(), Pose(-1.0, 0.5, 1.0)
    assert reference(node, goal=goal) == goal
    assert reference(node, at(-1.0, 0.5)) == goal
    node.reset()
    assert reference(node) == SQUARE_WAYPOINTS[0]


EXPECTED = [Pose(1.0, 2.0, 0.5), Pose(-1.0, 0.0, 0.0)]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.yaml", "[[1, 2, 0.5], [-1, 0, 0]]"),
        ("a.yml", "waypoints:\n  - {x: 1, y: 2, theta: 0.5}\n  - [-1, 0, 0]\n"),
        ("a.csv", "x,y,theta\n1,2,0.5\n-1,0,0\n"),
        ("a.csv", "# comment\n1, 2, 0.5\n\n-1, 0, 0\n"),
    ],
)
def test_files(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    assert _load_waypoints(str(tmp_path / name)) == EXPECTED
    assert reference(generator(waypoints=str(tmp_path / name))) == EXPECTED[0]


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("a.yaml", "[[1, 2]]", "entry 1 .* must be x, y and theta"),
        ("a.yaml", "- [1, 2, 0]\n- {x: 1, y: 2}\n", "entry 2"),
        ("a.yaml", "- {x: 1, y: 2, theta: 0, z: 3}\n", "entry 1"),
        ("a.yaml", "[1, 2, 3]", "entry 1"),
        ("a.yaml", "{[", "not YAML"),
        ("a.yaml", "hello", "must hold a list"),
        ("a.yaml", "", "must hold a list"),
        ("a.yaml", "[]", "one or more finite poses"),
        ("a.yaml", "[[1, .nan, 0]]", "finite poses"),
        ("a.csv", "x,y,theta\n1,2\n", "entry 1"),
        ("a.csv", "1,2,north\n", "entry 1"),
        ("a.csv", "x,y,theta\n", "one or more finite poses"),
        ("a.txt", "1 2 3", "'room', or a"),
    ],
)
def test_a_malformed_file_is_refused(tmp_path, name, text, said):
    (tmp_path / name).write_text(text)
    with pytest.raises(ValueError, match=said):
        generator(waypoints=str(tmp_path / name))
