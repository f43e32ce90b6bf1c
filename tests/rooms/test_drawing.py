"""Rooms that are drawn: always with a way through, never the same, and as their rules say."""

import math
from dataclasses import fields, replace

import numpy as np
import pytest
from compiled_rooms import draw_compiled

from turtlebot_gym.compiled.packing import as_tuple
from turtlebot_gym.envs.navigation_vector import NavigationVectorEnv
from turtlebot_gym.models.random import episode_key
from turtlebot_gym.rooms.drawing import capacity, draw
from turtlebot_gym.rooms.geodesic import way_left
from turtlebot_gym.rooms.rules import ROOMS, RoomRules
from turtlebot_gym.rooms.scene import arrays_of
from turtlebot_gym.rooms.sensing import clearance


@pytest.mark.parametrize("name", ROOMS)
def test_a_way_leads_through_each_room(empty_scene, name):
    rules, counts, rooms, see = ROOMS[name], [], set(), []
    for number in range(200):
        scene = empty_scene(rules)
        start, goal = draw_compiled(scene, as_tuple(rules), 0.105, episode_key(number, 0))
        straight = math.hypot(goal.x - start.x, goal.y - start.y)
        assert straight >= rules.min_distance
        if rules.through:
            assert min(-start.x, goal.x) > 0.6 * rules.half_length
        walkers = scene.room.circles[: scene.room.counts[0], 3:]
        for place in (start, goal):
            # A cell's centre keeps 0.205 m, and a place is at most half a diagonal away from it; what walks is not asked.
            assert walkers.any() or clearance(scene, place.x, place.y) > 0.205 - 0.0708
        speeds = np.hypot(*walkers.T) if rules.speed[1] else np.array(rules.speed)
        assert ((speeds >= rules.speed[0] - 1e-9) & (speeds <= rules.speed[1] + 1e-9)).all()
        assert straight - 0.2 <= way_left(scene, start.x, start.y) < 60.0
        counts.append(scene.room.counts.tolist())
        see.extend(scene.room.people[: len(walkers), 5])
        rooms.add(scene.room.circles.tobytes() + scene.room.boxes.tobytes())
    circles, boxes = np.array(counts).T
    assert len(rooms) == 200
    assert (circles.max() <= capacity(rules)[0], boxes.max() <= capacity(rules)[1]) == (True, True)
    if name in ("clutter", "crowd", "corridor"):
        assert {circles.min(), circles.max()} == set(map(int, rules.circles))
        assert {boxes.min(), boxes.max()} == set(map(int, rules.boxes))
    if name == "dense":
        assert set(circles + boxes) == {14}
    if rules.people:
        assert abs(np.mean(see) - (1.0 - rules.blind)) < 0.06  # four standard errors of 900 people


def test_a_room_that_cannot_be_passed_loses_what_stands_in_it(empty_scene):
    rules = RoomRules(circles=(60.0, 60.0), radius=(0.6, 0.8))
    scene = empty_scene(rules)
    start, _ = draw_compiled(scene, as_tuple(rules), 0.105, 5)
    assert scene.room.counts.tolist() == [0, 0]
    assert way_left(scene, start.x, start.y) >= 1.3


PAIRS = {"circles": (5.0, 6.0), "boxes": (3.0, 4.0), "radius": (0.2, 0.25), "speed": (0.3, 0.4)}
CHANGES = PAIRS | {"kind": 2.0, "half_length": 3.0, "half_width": 3.0, "total": 2.0, "people": True, "through": True}
CHANGES |= {"min_distance": 3.5, "max_distance": 2.0, "start": (0.0, 0.0, 0.0), "goal": (0.0, 0.0, 0.0)}


def test_each_rule_changes_the_room_or_where_the_robot_starts(empty_scene):
    base = RoomRules(kind=1.0, circles=(2.0, 4.0), boxes=(1.0, 2.0), speed=(0.1, 0.2))

    def drawn(rules):
        scene = empty_scene(replace(rules, circles=(0.0, 60.0), boxes=(0.0, 60.0), half_length=5.0, half_width=5.0))
        worlds = [draw(scene, rules, 0.105, key, 0.1) for key in (1, 2, 5)]
        return str(worlds) + str([part.tolist() for part in arrays_of(scene)])

    first = drawn(base)
    assert drawn(base) == first
    for name, value in CHANGES.items():
        assert drawn(replace(base, **{name: value})) != first, name
    caves, people = replace(ROOMS["cellular"], half_length=1.5, half_width=1.5), replace(base, people=True)
    assert drawn(caves) != drawn(replace(caves, fill=0.1))
    assert drawn(people) != drawn(replace(people, blind=1.0))
    # Courtesy shows when they walk: test_walking.
    assert {*CHANGES} | {"fill", "blind", "courtesy"} == {field.name for field in fields(RoomRules)}


@pytest.mark.parametrize("world", ["people", "crowd"])
def test_a_robot_that_stands_at_its_start_is_left_alone_for_a_second(world):
    """One drive in twenty among people used to end within that second, before a robot could see them come and stop."""
    envs = NavigationVectorEnv(1000, task="room", world=world, lidar="ideal", noise="clean", info="full")
    _, info = envs.reset(seed=0)
    least = info["clearance"]
    for _ in range(10):
        *_, info = envs.step(np.zeros((1000, 2), np.float32))
        least = np.minimum(least, info["clearance"])
    assert least.min() > 0.0
