"""Tasks: starts and goals, what the policy observes, arrival and reward."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from turtlebot_gym.heart import Episode, step
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.models.random import episode_key
from turtlebot_gym.observations import OPEN_GROUND, Observation, goal_from, next_goal_from, twist_of, uncertainty_of
from turtlebot_gym.observations.columns import bounds_of
from turtlebot_gym.robots import ROBOTS
from turtlebot_gym.systems import Options, make_parameters
from turtlebot_gym.tasks import NAV, POSE, SQUARE_WAYPOINTS, arrived, believed_to_arrive, draw_goal, remaining, start_pose
from turtlebot_gym.values import Command, Covariance, Pose, State

BURGER = ROBOTS["burger"]
GOAL, NEXT = Pose(2.0, 0.0, 1.0), Pose(2.0, 2.0, 0.0)
KEYS = [episode_key(seed, 0) for seed in range(3000)]


def seen(state, *, std=(0.1, 0.2), nis=3.0, reference=GOAL, following=NEXT):
    goals, P = (goal_from(state, reference), next_goal_from(state, following)), Covariance(std[0] ** 2, 0, 0, 0, 0, std[1] ** 2)
    return Observation(*goals[0], *twist_of(state, BURGER), *uncertainty_of(P, nis), *goals[1])


def test_observation_in_the_body_frame():
    at_origin = seen(State(0.0, 0.0, 0.0, 0.1054, -1.3175))
    assert at_origin == pytest.approx(
        (2.0, 1.0, 0.0, math.cos(1.0), math.sin(1.0), 0.5, -0.5, 0.1, 0.2, 3.0, math.sqrt(8.0), math.sqrt(0.5), math.sqrt(0.5))
    )
    looking_left = seen(State(0.0, 0.0, math.pi / 2.0, 0.0, 0.0))
    assert (looking_left.cos_bearing, looking_left.sin_bearing) == pytest.approx((0.0, -1.0))
    assert (looking_left.cos_turn, looking_left.sin_turn) == pytest.approx((math.sin(1.0), -math.cos(1.0)))
    at_goal = seen(State(2.0, 0.0, 2.0, 0.0, 0.0), following=GOAL)  # where the bearing is straight ahead
    assert at_goal[:3] == at_goal[10:] == (0.0, 1.0, 0.0)


def test_the_remaining_distance_is_counted_past_a_completed_waypoint():
    """Waypoints at (2, 1) and (2, 4), 3 m apart; the robot is 5 m away from the second."""
    robot, reference, following = State(-2.0, 1.0, 0.0, 0.0, 0.0), Pose(2.0, 1.0, 0.0), Pose(2.0, 4.0, 0.0)
    assert remaining(robot, reference, following, False) == pytest.approx(4.0)
    assert remaining(robot, reference, following, True) == pytest.approx(5.0 - 3.0)


def test_observation_does_not_depend_on_the_world_frame():
    rng = np.random.default_rng(0)
    for _ in range(200):
        x, y, theta, u, v = rng.uniform(-3.0, 3.0, 5).tolist()
        turn, dx, dy = rng.uniform(-3.0, 3.0, 3).tolist()

        def moved(pose, turn=turn, dx=dx, dy=dy):
            c, s = math.cos(turn), math.sin(turn)
            return Pose(dx + c * pose[0] - s * pose[1], dy + s * pose[0] + c * pose[1], wrap(pose[2] + turn))

        state = State(x, y, theta, u, v)
        there = seen(State(*moved(state), u, v), reference=moved(GOAL), following=moved(NEXT))
        assert there == pytest.approx(seen(state), abs=1e-12)


def test_observations_are_clipped_to_their_bounds():
    rng = np.random.default_rng(1)
    low, high = np.array(bounds_of(OPEN_GROUND))
    for scale in 10.0 ** rng.uniform(-9.0, 9.0, 500):
        x, y, v, omega, *std, nis = (scale * rng.normal(size=7)).tolist()
        state = State(x, y, float(rng.uniform(-math.pi, math.pi)), v, omega)
        observation = np.array(seen(state, std=tuple(map(abs, std)), nis=abs(nis)))
        assert ((low <= observation) & (observation <= high)).all()
    assert seen(State(0.0, 1e9, 0.0, 9.0, -99.0), std=(9.0, 9.0), nis=1e9)[5:11] == (2.0, -2.0, 5.0, math.pi, 25.0, 20.0)


TURNED = State(2.0, 0.1, 1.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("state", "goal", "task", "there"),
    [
        *((State(2.0 - distance, 0.0, -2.0, 0.2, 2.0), GOAL, NAV, distance < 0.15) for distance in (0.0, 0.149, 0.151)),
        *((TURNED._replace(theta=theta), GOAL, POSE, theta != 1.21) for theta in (1.0, 1.19, 0.81, 1.21)),
        *((TURNED._replace(omega=omega), GOAL, POSE, abs(omega) < 0.51) for omega in (0.5, -0.5, 0.51, -0.51)),
        (State(0.0, 0.0, -3.1, 0.0, 0.0), Pose(0.0, 0.0, 3.1), POSE, True),  # headings meet across pi
    ],
)
def test_a_point_wants_the_position_and_a_pose_the_heading_too_without_spinning(state, goal, task, there):
    assert arrived(state, goal, task) is there


@pytest.mark.parametrize(
    ("radius", "margin", "reach"),
    [(0.15, 0.05, 0.1), (0.3, 0.05, 0.25), (0.09, 0.05, 0.06), (0.15, 0.0, 0.15), (0.15, 1.0, 0.1)],
)
def test_a_belief_arrives_within_the_margin_which_is_a_third_of_the_radius_at_most(radius, margin, reach):
    task = replace(NAV, radius=radius, margin=margin)
    for distance, there in ((0.0, True), (reach - 1e-6, True), (reach + 1e-6, False)):
        assert believed_to_arrive(State(2.0 - distance, 0.0, -2.0, 0.2, 2.0), GOAL, task) is there
    assert not believed_to_arrive(State(2.0, 0.0, 1.5, 0.0, 0.0), GOAL, POSE)  # by the heading


def test_starts_and_goals_fill_the_arena():
    # Kolmogorov and Smirnov on 6 coordinates: perfect draws fail for one seed in 10^5.
    starts = np.array([start_pose(key, NAV) for key in KEYS])
    goals = np.array([draw_goal(key, Pose(99.0, 99.0, 0.0), NAV) for key in KEYS])  # too far away to be refused
    for poses in (starts, goals):
        assert np.abs(poses[:, :2]).max() <= 2.0
        assert ((-math.pi <= poses[:, 2]) & (poses[:, 2] < math.pi)).all()
        for column, reach in zip(poses.T, (2.0, 2.0, math.pi), strict=True):
            assert stats.kstest(column, "uniform", args=(-reach, 2.0 * reach)).pvalue > 1e-5 / 6.0
    assert abs(np.corrcoef(starts[:, :2].T, goals[:, :2].T)[:2, 2:]).max() < 4.0 * stats.norm.isf(0.05) / math.sqrt(len(KEYS))


@pytest.mark.parametrize("task", [NAV, replace(NAV, min_distance=2.0), replace(NAV, arena=5.0)])
def test_goals_keep_their_distance(task):
    for key in KEYS[:500]:
        start = start_pose(key, task)
        first = draw_goal(key, start, task)
        assert math.dist(start[:2], first[:2]) >= task.min_distance
        assert max(map(abs, first[:2])) <= task.arena


def placed(world, truth):
    """Return the world with another true state."""
    return world._replace(body=world.body._replace(true_state=truth))


def walk(task, steps, *, teleports=True, **options):
    """Drive a robot that is put where it should be, or stays where it is; return the outcomes and worlds."""
    task, waypoints = Options(task=task, **options).course()
    episode, log = Episode(make_parameters(task, noise="clean"), waypoints), []
    for _ in range(steps):
        if teleports:
            episode.world = placed(episode.world, State(*episode.world.course.reference, 0.0, 0.0))
        come = episode.step(Command(0.0, 0.0))
        log.append((come, episode.world))
        if come.terminated:
            break
    return log


@pytest.mark.parametrize("laps", [1, 3])
def test_the_square_ends_when_all_its_waypoints_are_reached_in_order(laps):
    log, number = walk("square", 100, laps=laps), 4 * laps
    assert [(come.terminated, come.is_success) for come, _ in log] == [(False, False)] * (number - 1) + [(True, True)]
    goals = [SQUARE_WAYPOINTS[k % 4] for k in range(number)]
    assert [world.course.reference for _, world in log] == [*goals[1:], goals[-1]]
    assert [world.course.following for _, world in log] == [*goals[2:], goals[-1], goals[-1]]  # after the last there is none


def test_the_square_by_time_switches_every_15_s_and_does_not_end():
    log = walk("square", 700, teleports=False, switch="time")
    switches = [k + 1 for k, (come, _) in enumerate(log) if come.reached]
    assert switches[:4] == [150, 300, 450, 600]
    assert not any(come.terminated for come, _ in log)
    assert [world.course.reference for _, world in log[149:600:150]] == [*SQUARE_WAYPOINTS[1:], SQUARE_WAYPOINTS[3]]


@pytest.mark.parametrize("arrival", ["truth", "belief"])
def test_arrival_by_belief_may_be_wrong_and_is_then_no_success(arrival):
    task, waypoints = Options(task="square", arrival=arrival, waypoints=[Pose(1.0, 0.0, 0.0)]).course()
    p = make_parameters(task, noise="clean", filter=replace(make_parameters(noise="clean").tuning, R=(100.0,) * 3))
    episode = Episode(p, waypoints)
    world, key = episode.world, episode.key
    certain = world.estimate.belief._replace(mean=State(1.0, 0.0, 0.0, 0.0, 0.0), covariance=Covariance(*[0.0] * 8))
    deluded = world._replace(estimate=world.estimate._replace(belief=certain))
    there = placed(world, State(1.0, 0.0, 0.0, 0.0, 0.0))
    for start, ends in ((deluded, (arrival == "belief", False)), (there, (arrival == "truth", arrival == "truth"))):
        _, come = step(episode.system, start, Command(0.0, 0.0), key, waypoints, p, ())
        assert (come.terminated, come.is_success) == ends
