"""Missions: successive goals, the same compiled and in plain Python."""

from itertools import pairwise

import numpy as np

from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.heart import Episode
from turtlebot_gym.rooms.geodesic import way_left
from turtlebot_gym.systems import Options
from turtlebot_gym.tasks import Task
from turtlebot_gym.values import Command

EASY = Task(radius=1.2, on_belief=True, laps=50, patience=3.0)
"""Goals that random driving reaches, or gives up soon."""


def mission(**options):
    p, waypoints, *_ = Options(task=EASY, world="clutter", lidar="ideal", noise="wheel", **options).setup()
    return p, waypoints


def test_missions_are_the_same_compiled_and_in_plain_python(in_step):
    p, waypoints = mission()
    batch = Batch(35, p, waypoints)
    plain = {i: Episode(p, waypoints, seed=i) for i in (0, 33)}
    for _ in in_step(batch, plain, [0.0, -0.5], [1.2, 0.5], 120):
        pass
    for i, episode in plain.items():
        assert episode.world.course.visited >= 3.0
        np.testing.assert_array_equal(batch.system.surroundings.at(batch.scenes, i).room.ways, episode.scene.room.ways)


def goals_of(command, seed):
    p, waypoints = mission()
    episode, goals = Episode(p, waypoints, seed=seed), []
    for _ in range(150):
        goal, truth = episode.world.course.reference, episode.world.body.true_state
        if goal not in goals:
            goals.append(goal)
            assert way_left(episode.scene, goal.x, goal.y) < 0.1  # the paths lead to it ...
            assert episode.world.room.way == way_left(episode.scene, truth.x, truth.y) > 0.0  # ... from the robot
        episode.step(command)
    return goals


def test_the_goals_depend_on_the_episode_and_not_on_how_the_robot_drives():
    here, there = goals_of(Command(0.0, 0.0), 4), goals_of(Command(0.1, 0.3), 4)
    both = min(len(here), len(there))
    assert both >= 4
    assert here[:both] == there[:both] != goals_of(Command(0.0, 0.0), 5)[:both]
    least = mission()[0].room.rules.min_distance
    assert all(np.hypot(b.x - a.x, b.y - a.y) >= least for a, b in pairwise(here))


def test_a_goal_that_is_not_reached_in_time_is_given_up_and_the_mission_ends_with_its_goals():
    p, waypoints = mission(goals=3)
    episode = Episode(p._replace(task=Task(radius=1e-3, laps=3, patience=2.0)), waypoints)
    reached = [episode.step(Command(0.0, 0.0)).reached for _ in range(60)]
    assert np.flatnonzero(reached).tolist() == [19, 39, 59]
    assert (episode.outcome.terminated, episode.outcome.is_success) == (True, False)
