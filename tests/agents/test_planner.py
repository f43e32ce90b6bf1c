"""The planner: its grid, its paths, its memory, and batches of which some rows are dropped."""

import heapq
from functools import partial

import numpy as np
import pytest
import sights

from turtlebot_gym.rooms.lidar import SECTORS, SIGHT
from turtlebot_gym_agents.evaluation.evaluate import evaluate
from turtlebot_gym_agents.policies import grid, make_policy
from turtlebot_gym_agents.policies.cheapest_way import cheapest_way
from turtlebot_gym_agents.policies.grid import CELL, OCCUPIED, SIDE
from turtlebot_gym_agents.policies.planner import PlannerPolicy
from turtlebot_gym_agents.policies.sight import SightMotion

ROOMS = "turtlebot_gym/TurtleBotRooms-v0"
NOTHING = np.ones(SECTORS)
sight = partial(sights.sight, age=0.2)
WALL = np.ones(SECTORS)
"""A wall across the way, 0.8 m ahead, which is longer on the right."""
WALL[-6:], WALL[:3] = (0.8 / SIGHT / np.cos(np.radians(10.0 * k)) for k in (np.arange(6, 0, -1), np.arange(3)))


def cells(policy, row=0):
    """Return the places of occupied cells in the frame of the first goal that was given, as complex numbers."""
    memory = policy._memory
    down, along = np.nonzero(memory.grid[row] >= OCCUPIED)
    places = CELL * (along + 0.5 - SIDE // 2 + 1j * (down + 0.5 - SIDE // 2))
    return (places - memory.frame[row, 0]) / memory.frame[row, 1]


def test_the_cheapest_path_is_dijkstras():
    random = np.random.default_rng(2)
    for _ in range(30):
        weights = np.where(random.random((17, 12)) < 0.4, 400, random.integers(4, 20, (17, 12))).astype(np.int32)
        weights[0], weights[-1], weights[:, 0], weights[:, -1] = 0, 0, 0, 0
        start, goal = (12 * random.integers(1, 16, 2) + random.integers(1, 11, 2)).tolist()
        best, queue = {}, [(0, goal)]
        while queue:
            cost, cell = heapq.heappop(queue)
            if cell not in best:
                best[cell] = cost
                for step in (-13, -12, -11, -1, 1, 11, 12, 13):
                    if weight := int(weights.ravel()[cell + step]):
                        heapq.heappush(queue, (cost + (5 if abs(step) in (1, 12) else 7) * weight, cell + step))
        costs, following = np.empty((2, weights.size), np.int64)
        cheapest_way(weights.ravel(), 12, start, goal, costs, following)
        assert costs[start] == best[start]
        while start != goal:
            assert costs[start] == best[start]
            start = following[start]


def test_machine_code_is_plain_python_to_the_bit():
    random, policy = np.random.default_rng(3), PlannerPolicy()
    compiled, plain = ([*(np.zeros((2, SIDE, SIDE), np.int8) for _ in range(3)), np.zeros((2, 2))] for _ in range(2))
    for _ in range(5):
        scans, shares = random.uniform(-2.0, 2.0, (2, 3)), np.minimum(random.uniform(0.1, 1.3, (2, SECTORS)), 1.0)
        places, goals, yes = random.uniform(-2.0, 2.0, (2, 2)), random.uniform(-9.0, 9.0, (2, 2)), np.ones(2, np.bool_)
        for function, (seen, failed_attempts, ways, targets) in ((grid.advance, compiled), (grid.advance._function, plain)):
            reaches, numbers = np.array([3.4, 2.0]), (policy._stamp, 2.0, 1.15, 6, 4)
            function(seen, failed_attempts, ways, scans, reaches, shares, yes, places, goals, yes, yes, *numbers, targets)
        for array, expected in zip(compiled, plain, strict=True):
            np.testing.assert_array_equal(array, expected)
    assert (compiled[0] >= OCCUPIED).sum() > 50
    assert compiled[1].any()
    assert compiled[2].any()


def test_a_place_is_occupied_where_beams_end_and_free_again_when_they_pass():
    policy = PlannerPolicy()
    for _ in range(2):
        policy(sight(shares=WALL))
        policy(sight(shares=WALL * np.float32(1.001)))  # a scan is entered when it is another one
    seen = cells(policy) - (-2.0)
    assert len(seen) > 8
    assert seen.real == pytest.approx(0.8, abs=0.2)
    for k in range(20):
        policy(sight(shares=NOTHING - 1e-3 * (k % 2)))
    assert not [place for place in cells(policy) + 2.0 if abs(place) < 1.5]


@pytest.mark.parametrize("name", ["planner", "planner+safety"])
def test_a_wall_is_gone_around_also_when_it_is_no_longer_seen_until_its_row_is_forgotten(name):
    """It is shorter on the left."""
    policy = make_policy(name)
    for _ in range(3):
        assert policy(np.array([sight(shares=WALL)] * 2))[:, 1].min() > 0.2
    policy.reset(np.array([False, True]))
    remembers, forgot = policy(np.array([sight()] * 2))[:, 1]
    assert remembers > 0.2
    assert forgot == pytest.approx(0.0, abs=1e-6)


def test_the_grid_moves_with_its_robot():
    policy, post = PlannerPolicy(), np.ones(SECTORS)
    post[9] = 1.0 / SIGHT
    for x in np.arange(0.0, 11.0, 0.25):
        policy(sight((15.0, 0.0, 0.0), at=(x, 0.0, 0.0), shares=post if x == 5.0 else NOTHING))
        assert np.abs(policy._memory.pose[0, 0]) < 0.3 * SIDE * CELL
    assert cells(policy) == pytest.approx(5.0 - 15.0 + 1j, abs=0.2)


def test_a_robot_that_moves_back_and_forth_is_stuck_and_one_that_turns_round_is_not():
    policy, way = PlannerPolicy(), np.concatenate([np.arange(40), np.arange(40, 0, -1)])
    for place, is_stuck in ((0.02 * way, False), (0.02 * (np.arange(80) % 10), True)):
        policy.reset(np.array([True]))
        stuck = []
        for x in place:
            policy(sight(at=(x, 0.0, 0.0), v=0.2)[None])
            stuck.append(policy.stuck[0])
        assert any(stuck) == is_stuck


def test_cells_cost_more_the_nearer_they_are_to_an_occupied_cell():
    stamp = PlannerPolicy()._stamp  # by hand: a robot 0.1 m away would touch it, 2.3 more at 0.14 m, 1.0 at 0.2 m, 0 at 0.28 m
    assert stamp[3].tolist() == stamp[:, 3].tolist() == [4, 5, 400, 400, 400, 5, 4]
    assert np.diag(stamp).tolist() == [4, 4, 6, 400, 6, 4, 4]


def test_a_path_over_ground_seen_to_be_free_is_preferred_to_a_slightly_shorter_one():
    """The goal is behind a post in the middle; the ground was seen on the left."""
    for side in (-1, 1):
        seen, target = np.zeros((SIDE, SIDE), np.int8), np.zeros(2)
        seen[SIDE // 2 : SIDE // 2 + 2, SIDE // 2 + 10] = grid.CERTAIN
        seen[SIDE // 2 + side * np.arange(2, 9), SIDE // 2 : SIDE // 2 + 20] = grid.FREED
        failed_attempts, ways, stamp = np.zeros_like(seen), np.zeros_like(seen), PlannerPolicy()._stamp
        grid.plan(seen, failed_attempts, ways, False, (0.0, 0.1), (2.0, 0.1), stamp, 4.0, 1.0, 6, 4, target)
        assert np.sign(target[1] - 0.1) == side


def test_the_last_path_is_kept_until_another_is_much_shorter_or_the_robot_is_stuck():
    """A wall is ahead, as long on the left as on the right, and is then seen to be longer where the way leads past it."""
    stamp, target = PlannerPolicy()._stamp, np.zeros(2)
    for grows, habit, stuck, changes in ((1, 0, False, True), (1, 4, False, False), (8, 4, False, True), (1, 4, True, True)):
        seen, failed_attempts, ways = (np.zeros((SIDE, SIDE), np.int8) for _ in range(3))
        seen[SIDE // 2 - 8 : SIDE // 2 + 8, SIDE // 2 + 10] = grid.CERTAIN
        sides = []
        for _ in range(2):
            grid.plan(seen, failed_attempts, ways, stuck, (0.0, 0.02), (2.0, 0.02), stamp, 4.0, 1.0, 4, habit, target)
            sides.append(np.sign(target[1]))
            end = SIDE // 2 + 8 if sides[0] > 0 else SIDE // 2 - 8 - grows
            seen[end : end + grows, SIDE // 2 + 10] = grid.CERTAIN
        assert (sides[0] != sides[1]) == changes


def test_the_motion_since_a_scan_follows_from_the_speeds_at_that_time():
    """The robot drove, turned to the left for 0.2 s, then to the right, and is about to stand."""
    motion = SightMotion(0.1, 0.1)
    motion.reset(np.array([True]))
    for v, omega in ((0.2, 0.0), (0.0, 2.0), (0.0, 2.0), (0.0, -1.0), (0.0, 0.0)):
        motion.note(np.array([v]), np.array([omega]))
    for time, moved, turned in ((0.05, 0.0, -0.05), (0.2, 0.0, 0.1), (0.35, 0.01, 0.3)):
        place, heading = motion.over(np.array([time]))
        assert np.abs(place) == pytest.approx(moved)
        assert np.angle(heading) == pytest.approx(turned)


@pytest.mark.parametrize(("ages", "beams"), [([0.0, 0.1, 0.0], [0.1, 0.2, 0.1]), ([0.2, 0.3, 0.2], [0.1, 0.2, 0.1])])
def test_beams_are_as_old_whether_a_scan_is_stamped_with_its_first_or_its_last(ages, beams):
    motion = SightMotion(0.1, 0.1)
    motion.note(np.array([0.0]), np.array([1.0]))
    assert [np.angle(motion.since(np.array([age]))[1])[0] for age in ages] == pytest.approx(beams)


@pytest.mark.parametrize("name", ["vfh", "planner", "vfh+safety", "planner+safety", "ppo-rooms+safety"])
def test_rows_do_not_depend_on_each_other(name):
    random = np.random.default_rng(4)
    shares = np.minimum(random.uniform(0.04, 1.3, (15, 6, SECTORS)), 1.0)
    rows = np.array([[sight(shares=ranges) for ranges in step] for step in shares])
    kept, (whole, part) = np.array([True, False, True, True, False, False]), (make_policy(name) for _ in range(2))
    for policy, mask in ((whole, np.ones(6, np.bool_)), (part, np.ones(3, np.bool_))):
        policy.reset(mask)
    for step in rows:
        np.testing.assert_allclose(whole(step)[kept], part(step[kept]), rtol=0.0, atol=1e-6)


@pytest.mark.slow
def test_in_an_office_memory_finds_the_doors():
    """40 offices. With a success of 0.985 and 0.8, a bound is missed by fewer than one seed in a thousand."""
    names = "vfh", "planner+safety"
    vfh, planner = (evaluate(name, env=ROOMS, world="office", episodes=40, seed=3).episodes for name in names)
    assert planner.success.mean() >= 0.9
    assert vfh.success.mean() < 0.99
    assert not planner.collision.any()
