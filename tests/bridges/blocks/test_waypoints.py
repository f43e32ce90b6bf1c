"""The reference: what is published, and when it changes."""

import pytest

from turtlebot_gym.estimation.ekf import Estimate
from turtlebot_gym.heart import Episode
from turtlebot_gym.systems import Options, make_parameters
from turtlebot_gym.tasks import SQUARE_WAYPOINTS
from turtlebot_gym.values import STOP, Belief, Covariance, Pose, State
from turtlebot_gym_ros.blocks import VelocityController, WaypointGenerator
from turtlebot_gym_ros.node.errand import Failure


def generator(**parameters):
    return WaypointGenerator(WaypointGenerator.Params(**parameters))


def at(x, y, theta=0.0):
    return Estimate(Belief(State(x, y, theta, 0.0, 0.0), Covariance(*[0.0] * 8)), 0.0, 0.0)


def reference(node, estimate=None, goal=None):
    return node.step(0.1, estimate, goal)["reference"]


@pytest.mark.parametrize("laps", [1, 2])
def test_waypoints_are_taken_in_order_on_arrival_in_each_lap(laps):
    node, course = generator(laps=laps), laps * [*SQUARE_WAYPOINTS]
    reference(node, at(course[0].x, course[0].y))  # an episode's first estimate is not judged, as in the environment
    for here, there in zip(course, [*course[1:], course[-1]], strict=True):
        assert reference(node, at(here.x + 0.26, here.y)) == here
        assert reference(node) == here  # without an estimate nothing is reached
        assert reference(node, at(here.x + 0.24, here.y)) == there
    assert node.step(0.1, at(0.0, 0.0), None)["following"] == course[-1]  # the last one stays


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


def test_a_pose_from_rviz_takes_the_place_of_all_waypoints():
    node, goal = generator(), Pose(-1.0, 0.5, 1.0)
    assert reference(node, goal=goal) == goal
    assert reference(node, at(-1.0, 0.5)) == goal
    node.reset()
    assert reference(node) == SQUARE_WAYPOINTS[0]


def test_a_file_of_waypoints_is_read_or_refused(tmp_path):
    file = tmp_path / "a.yaml"
    file.write_text("[[1, 2, 0.5], [-1, 0, 0]]")
    read = {"reference": Pose(1.0, 2.0, 0.5), "following": Pose(-1.0, 0.0, 0.0)}
    assert generator(waypoints=str(file)).step(0.1, None, None) == read
    for wrong in ("[[1, 2]]", "hello", "[[1, .nan, 0]]"):
        file.write_text(wrong)
        with pytest.raises(ValueError, match="waypoints"):
            generator(waypoints=str(file))


# Goals on their way.


HERE = 1.0, 1.0
FOREIGN = "its frame is '/odom' instead of 'map'"


def located(**parameters):
    """Return a generator at `HERE`."""
    node = generator(**parameters)
    node.step(0.1, at(*HERE), None)
    return node


def test_a_goal_of_an_action_is_reached_when_the_controller_is_done_with_it():
    node, goal = located(), Pose(1.8, 1.0, 0.0)
    errand = node.send(goal, awaited=True)
    assert node.step(0.1, at(1.6, 1.0), None) == {"reference": goal, "following": goal}
    assert errand.is_active
    assert (errand.left, errand.time) == (pytest.approx(0.2, abs=0.1), 0.1)
    controller = VelocityController(VelocityController.Params())
    for x in (1.69, 1.71):  # the radius of 0.15 m, less 0.05 m
        node.step(0.1, at(x, 1.0), None)
        assert (controller.step(0.1, at(x, 1.0), goal, goal) == {}) == (errand.state == "reached") == (x == 1.71)


@pytest.mark.parametrize("before", ["square", "by time", "relative", "goal"])
def test_a_goal_that_is_refused_leaves_the_robot_where_it_is_until_another_one_or_a_reset(before):
    """Whatever it did before: no other drive takes the place of the one refused."""
    node = located(switch="time" if before == "by time" else "arrival", relative=before == "relative", switch_period=1.0)
    first = node.send(Pose(1.0, 1.8, 0.0)) if before == "goal" else None
    errand = node.refuse(FOREIGN)
    assert (errand.state, errand.code) == ("failed", Failure.NOT_LOCALIZED)
    stays = Pose(*HERE, 0.0)
    for k in range(50):
        assert node.step(0.1, at(1.0, 1.0 + 0.001 * k), None) == {"reference": stays, "following": stays}
        assert node.notice == f"goal refused, so the robot stays where it is: {FOREIGN}"
    assert first is None or first.reason == "another goal took its place"
    assert reference(node, at(*HERE), Pose(1.8, 1.0, 0.0)) == (1.8, 1.0, 0.0)
    assert node.notice is None
    node.refuse(FOREIGN)
    node.reset()
    assert node.notice is None
    assert reference(node, at(*HERE)) != stays


@pytest.mark.parametrize("tolerance", [0.15, 0.0])
def test_a_robot_whose_goal_is_cancelled_stays_where_it_is(tolerance):
    node = located(goal_tolerance=tolerance)
    errand = node.send(Pose(1.8, 1.0, 0.0), awaited=True)
    node.step(0.1, at(1.3, 1.0), None)
    node.cancel(errand)
    here = Pose(1.3, 1.0, 0.0)
    assert node.step(0.1, at(1.31, 1.0), None) == ({"reference": here, "following": here} if tolerance else {})
    assert errand.state == "cancelled"
    if tolerance:
        assert VelocityController(VelocityController.Params()).step(0.1, at(1.31, 1.0), here, here) == {}
    assert reference(node, at(1.31, 1.0), Pose(1.8, 1.0, 0.0)).x == 1.8  # until there is another goal


def test_what_is_awaited_is_given_up_with_the_reason():
    def drive(seconds, estimates, **parameters):
        node = located(patience=5.0, **parameters)
        errand, other = node.send(Pose(1.8, 1.0, 0.0), awaited=True), located(patience=5.0).send(Pose(1.8, 1.0, 0.0))
        for k in range(round(10 * seconds)):
            node.step(0.1, estimates(0.1 * k), None)
        assert other.is_active  # nobody waits for it
        return errand

    errand = drive(5.2, lambda time: at(*HERE))
    assert (errand.code, errand.reason.partition(":")[0]) == (Failure.NO_PROGRESS, "no progress for 5 s")
    errand = drive(5.2, lambda time: None)
    assert (errand.code, errand.reason) == (Failure.NOT_LOCALIZED, "lost: no estimate for 2.5 s")
    assert drive(7.0, lambda time: at(*HERE) if time > 2.0 else None).is_active  # it was found, and may go on
    assert drive(20.2, lambda time: at(1.0 + 0.03 * time, 1.0)).is_active  # it comes nearer
