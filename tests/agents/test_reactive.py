"""Policies that avoid obstacles: what they see, when an arc meets it, and how they do in rooms."""

import numpy as np
import pytest
from sights import BURGER, random_sights, sight, wall_ahead

from turtlebot_gym.rooms.lidar import SECTORS, SIGHT
from turtlebot_gym_agents.evaluation.evaluate import evaluate
from turtlebot_gym_agents.policies import make_policy
from turtlebot_gym_agents.policies.sight import UNSEEN, arc, look, time_to_contact

ROOMS = "turtlebot_gym/TurtleBotRooms-v0"
IN_ROOMS = ("vfh", "planner")


def mirrored(rows):
    """Return what is seen in a mirror along the robot's axis."""
    out = rows.copy()
    for column in (2, 4, 6, 12):  # sines of bearing and turn, turning rate, sine of the next bearing
        out[:, column] *= -1.0
    out[:, 13 + 1 : 13 + SECTORS] = rows[:, 13 + SECTORS - 1 : 13 : -1]
    return out


def test_an_arc_ends_where_small_steps_end():
    for v, omega, time in ((0.2, 1.3, 2.0), (-0.1, 2.0, 1.0), (0.2, 0.0, 3.0), (0.0, 2.0, 1.0), (0.2, 1e-9, 1.0)):
        pose, heading, n = 0j, 0.0, 20000
        for _ in range(n):
            pose += v * time / n * np.exp(1j * (heading + 0.5 * omega * time / n))
            heading += omega * time / n
        end, turned = arc(v, omega, time)
        assert end == pytest.approx(pose, abs=1e-6)
        assert turned == pytest.approx(np.exp(1j * heading), abs=1e-9)


def test_the_time_to_contact_is_that_of_a_drive_in_small_steps():
    random = np.random.default_rng(3)
    times = np.arange(0.0, 6.0, 1e-3)
    points = np.array([0.1 + 0.0j])  # in contact, from where it may back out or turn
    held = [time_to_contact(points, np.array([v]), np.array([omega]), 0.12)[0] for v, omega in ((0.2, 0), (-0.2, 0), (0, 2.0))]
    assert held == [0.0, np.inf, np.inf]
    met = 0
    for _ in range(1200):
        v, omega = random.uniform(-0.25, 0.25), random.choice([0.0, 1.0]) * random.uniform(-2.5, 2.5)
        point = complex(*random.uniform(-0.6, 0.6, 2))
        if abs(point) < 0.16:
            continue
        path, _ = arc(v, omega, times)
        away = np.abs(path - point)
        predicted = time_to_contact(np.array([point]), np.array([v]), np.array([omega]), 0.15)[0]
        if away.min() > 0.1501:
            assert predicted > times[-1], (v, omega, point)
        elif away.min() < 0.1499:
            met += 1
            assert predicted == pytest.approx(times[np.argmax(away <= 0.15)], abs=0.02), (v, omega, point)
    assert met > 50


def test_an_old_scan_is_seen_from_where_the_robot_will_be():
    """A post 1 m away, measured 0.3 s ago by a robot that has driven a bend since, and continues for a step."""
    v, omega, age, lag, dt = 0.15, 1.2, 0.2, 0.1, 0.1
    shares = np.ones(SECTORS)
    shares[9] = 1.0 / SIGHT  # to the left
    to = look(sight(shares=shares, age=age, v=v, omega=omega), BURGER, dt, lag)
    pose, heading = arc(v, omega, age + lag + dt)
    assert to.points[9] == pytest.approx((1j - pose) / heading, abs=1e-5)
    assert (np.abs(np.delete(to.points, 9)) > 0.9 * UNSEEN).all()
    pose, heading = arc(v, omega, dt)  # the goal is known from the estimate, which is new
    assert to.goal == pytest.approx((2.0 - pose) / heading, abs=2e-3)


@pytest.mark.parametrize("name", [*IN_ROOMS, "bearing+safety", "vfh+safety"])
def test_a_batch_equals_its_rows_and_other_terms_are_refused(name):
    rows = random_sights(24)
    actions = make_policy(name)(rows)
    assert (actions.dtype, np.abs(actions).max() <= 1.0) == (np.float32, True)
    np.testing.assert_allclose(make_policy(name)(rows.reshape(2, 12, -1)), actions.reshape(2, 12, 2), rtol=0, atol=1e-5)
    with pytest.raises(
        ValueError, match=r"observations must have shape \(\.\.\., 50\) or \(\.\.\., 54\), with .*scan.*, got \(13,\)"
    ):
        make_policy(name)(np.zeros(13, np.float32))


@pytest.mark.parametrize("name", IN_ROOMS)
def test_the_goal_is_driven_to_but_not_into_a_wall_and_left_and_right_are_alike(name):
    def towards(*goal, wall=np.inf):
        return make_policy(name)(sight((*goal, 0.0), shares=wall_ahead(wall)))

    for (forward, turn), least, most in ((towards(2.0, 0.0), 0.9, 0.05), (towards(0.4, 0.0, wall=0.75), 0.5, 0.3)):
        assert forward > least  # also where the wall lies beyond the goal
        assert abs(turn) < most
    assert towards(2.0, 0.0, wall=0.13)[0] < 0.3
    assert towards(0.5, 1.0)[1] > 0.1
    rows = random_sights(200)
    seen, swapped = make_policy(name)(rows), make_policy(name)(mirrored(rows))
    alike = np.isclose(seen * (1.0, -1.0), swapped, rtol=0, atol=1e-4).all(axis=1)
    assert alike.mean() > 0.9  # where both sides are equally good, one of them is taken


LEFT, RIGHT = np.ones(SECTORS), np.ones(SECTORS)
LEFT[[0, 1]], RIGHT[[0, -1]] = 0.3 / SIGHT, 0.3 / SIGHT


@pytest.mark.parametrize("name", ["vfh", "vfh+safety"])
def test_vfh_keeps_to_the_side_that_it_chose_until_its_row_is_forgotten(name):
    """A post straight ahead, a little to the left at first, and then a little to the right, as noise has it."""
    policy, left, right = make_policy(name), *(np.array([sight(shares=shares)] * 2) for shares in (LEFT, RIGHT))
    for seen in (left, right):
        assert (policy(seen)[:, 1] < 0.0).all()
    policy.reset(np.array([False, True]))
    kept, turned = policy(right)[:, 1]
    assert kept < 0.0 < turned


def test_geometry_finds_its_way_and_the_oracle_bounds_it():
    """60 dense rooms. With the rates that 1000 had, a bound is missed by fewer than one seed in a thousand."""
    summaries = {name: evaluate(name, env=ROOMS, episodes=60, seed=3).summary() for name in ("vfh", "bearing", "oracle")}
    success = {name: s["success"].value for name, s in summaries.items()}
    assert success["oracle"] > 0.95
    assert success["vfh"] > 0.8 > success["bearing"] + 0.1
    assert summaries["vfh"]["collision"].value <= 0.05
    assert summaries["oracle"]["spl"].value >= max(s["spl"].value for s in summaries.values())
    assert all(0.0 <= s["barn"].value <= 0.5 for s in summaries.values())


@pytest.mark.parametrize(("away", "in_the_way"), [(0.28, True), (0.34, True), (0.37, False), (0.6, False)])
def test_obstacles_that_the_robot_would_touch_at_the_goal_block_it(away, in_the_way):
    """The goal is 0.25 m ahead, and the robot's radius is 0.105 m."""
    post = np.ones(SECTORS)
    post[0] = away / SIGHT
    policy = make_policy("vfh")
    assert bool(policy._blocked(policy._look(sight((0.25, 0.0, 0.0), shares=post)), policy.margin)[0]) is in_the_way


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_an_enclosed_robot_turns_to_the_side_chosen_last(side):
    policy = make_policy("vfh")
    assert policy(sight((1.0, side, 0.0)))[1] * side > 0.0
    forward, turn = policy(sight((1.0, -side, 0.0), shares=np.full(SECTORS, 0.13 / SIGHT)))
    assert forward == pytest.approx(0.0, abs=1e-9)
    assert turn * side > 0.5
