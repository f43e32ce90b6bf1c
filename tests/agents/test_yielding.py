"""A policy that stops for people: the law of its stop, where it drives on, and how much that helps."""

import numpy as np
import pytest

from turtlebot_gym.models.unicycle import limit
from turtlebot_gym.observations import NEAREST, ROOM, TRACKS
from turtlebot_gym.observations.columns import size_of
from turtlebot_gym.robots import ROBOTS
from turtlebot_gym.values import Command
from turtlebot_gym_agents.evaluation.evaluate import evaluate
from turtlebot_gym_agents.policies import make_policy
from turtlebot_gym_agents.policies.fit import ROOMS
from turtlebot_gym_agents.policies.protection import within_layer
from turtlebot_gym_agents.policies.sight import arc
from turtlebot_gym_agents.policies.yielding import Yielding, passing

AMONG = {"env": ROOMS, "world": "people", "noise": "wheel", "observation": "ekf,tracks"}
DT, FINE = 0.1, 10
"""Control interval, s, and number of moments in it that are looked at."""
SURE = np.sqrt(-np.log(0.05))
"""Radius that holds 95 % of a normal distribution in the plane, in roots of the trace of its covariance."""


class Wishes:
    """Wants to drive by random actions, each for some steps."""

    terms = ROOM

    def __init__(self, seed=0):
        self.random, self.actions = np.random.default_rng(seed), None

    def __call__(self, observations):
        new = self.random.uniform(-1.0, 1.0, (*np.shape(observations)[:-1], 2)).astype(np.float32)
        keeps = self.random.random(len(new)) < 0.8
        self.actions = new if self.actions is None else np.where(keeps[:, None], self.actions, new)
        return self.actions.copy()


def contacts(robot, lied=0.0, *, layer=False, robots=400, steps=80, seed=0):
    """Return how many robots touch somebody while they move, and the share of steps in which robots move.

    People walk straight on and turn round at the edge of a square. What is observed of each is off by as much as its deviations
    say, in random directions, and ``lied`` times as much.
    """
    random, policy = np.random.default_rng(seed), Yielding(Wishes(seed), robot)
    policy = within_layer(policy, robot, DT) if layer else policy
    body = ROBOTS[robot]
    limits = np.array([body.max_linear, body.max_angular])
    at, heading, twist = np.zeros(robots, complex), np.exp(2j * np.pi * random.random(robots)), np.zeros((robots, 2))
    people = (random.uniform(-2.0, 2.0, (robots, 4)) + 1j * random.uniform(-2.0, 2.0, (robots, 4))) * 1.5
    walks = random.uniform(0.2, 1.5, people.shape) * np.exp(2j * np.pi * random.random(people.shape))
    radius, touched, moved = random.uniform(0.15, 0.35, people.shape), np.zeros(robots, bool), 0
    for _ in range(steps):
        walks = np.where(np.abs(people - at[:, None]) > 3.0, np.abs(walks) * np.exp(1j * np.angle(at[:, None] - people)), walks)
        place, speed = random.uniform(0.0, 0.15, people.shape), random.uniform(0.0, 0.4, people.shape)
        off, wrong = ((1.0 + lied) * SURE * size * np.exp(2j * np.pi * random.random(people.shape)) for size in (place, speed))
        seen, seen_walks = ((part) * np.conj(heading)[:, None] for part in (people + off - at[:, None], walks + wrong))
        rows = np.zeros((robots, size_of((*ROOM, TRACKS))), np.float32)
        rows[:, 5:7], rows[:, 13:49], rows[:, 0] = twist / limits, 1.0, 1.0
        tracks = rows[:, -8 * NEAREST :].reshape(robots, NEAREST, 8)[:, :4]
        parts = (seen.real, seen.imag, seen_walks.real, seen_walks.imag, place, speed, radius)
        tracks[...] = np.stack([*parts, np.ones_like(place)], axis=-1)
        actions = policy(rows)
        moves = twist[:, 0] != 0.0
        moved += moves.mean() / steps
        for moment in range(1, FINE + 1):
            along, turned = arc(twist[:, 0], twist[:, 1], DT * moment / FINE)
            there = at + along * heading
            near = np.abs(people + walks * DT * moment / FINE - there[:, None]) < radius + body.radius - 1e-6
            touched |= moves & near.any(axis=1)
        at, heading, people = there, heading * turned, people + walks * DT
        twist = np.array([limit(Command(*command), body) for command in (actions * limits).tolist()])
    return int(touched.sum()), moved


@pytest.mark.parametrize("robot", ["burger", "turtlebot4"])
def test_no_robot_that_moves_touches_who_is_where_tracks_say(robot):
    touched, moved = contacts(robot)
    assert touched == 0
    assert moved > 0.3


def test_no_robot_within_the_safety_layer_does():
    touched, moved = contacts("burger", layer=True, robots=60, steps=60)
    assert touched == 0
    assert moved > 0.3


def test_the_law_fails_for_tracks_that_lie():
    assert contacts("burger", lied=1.0)[0] > 10


def stops(x, y, vx=0.0, vy=0.0, *, deviation=0.0, growth=0.0, certainty=1.0, action=(0.6, 0.2), **options):
    """Return whether a robot that stands remains so for somebody at a place with a velocity, in the robot's frame."""
    seen = np.zeros(size_of((*ROOM, TRACKS)), np.float32)
    seen[-8:] = x, y, vx, vy, deviation, growth, 0.25, certainty
    answer = Yielding(lambda rows: np.array(action, np.float32), **options)(seen)
    assert answer.tolist() in ([0.0, 0.0], np.array(action, np.float32).tolist())
    return not answer.any()


def test_it_stops_for_who_comes_near_before_it_stands_and_for_nobody_else():
    near = ROBOTS["burger"].radius + 0.25 + 0.012  # it drives on by 1.3 cm, and bends
    assert stops(near, 0.0)
    assert not stops(near + 0.02, 0.0)
    assert stops(near + 0.19, 0.0, -1.0, 0.0)
    assert not stops(near + 0.21, 0.0, -1.0, 0.0)
    assert not stops(near + 0.02, 0.0, 1.0, 0.0)
    assert stops(near + 0.1, 0.0, deviation=0.06)
    assert stops(near + 0.2, 0.0, growth=0.6)
    assert not stops(near + 0.2, 0.0, growth=0.6, confidence=0.3)
    assert not stops(0.2, 0.0, certainty=0.0)
    assert stops(near + 0.1, 0.0, certainty=0.5, deviation=0.06)
    assert stops(near + 0.1, 0.0, robot="waffle")


def test_passing_is_the_nearest_of_many_moments():
    random = np.random.default_rng(0)
    to, walks, grows = random.normal(size=(300, 2)), random.normal(size=(300, 2)), random.uniform(0.0, 1.5, 300)
    times = np.linspace(0.0, 1.5, 3001)
    for growth in (np.zeros(300), grows):
        at, least = passing(to, walks, 1.5, growth)
        away = np.linalg.norm(to[:, None] + walks[:, None] * times[:, None], axis=-1) - growth[:, None] * times
        np.testing.assert_allclose(least, away.min(axis=1), atol=2e-3)
        np.testing.assert_allclose(np.linalg.norm(to + walks * at[:, None], axis=-1) - growth * at, least)


def test_a_robot_is_stopped_alone_as_in_a_batch_and_by_any_of_all():
    rows = np.zeros((3, size_of((*ROOM, TRACKS))), np.float32)
    tracks = rows[:, -8 * NEAREST :].reshape(3, NEAREST, 8)
    tracks[...] = 2.0, 0.0, 0.0, 0.0, 0.1, 0.1, 0.25, 1.0
    tracks[1, 3, 0] = 0.3
    policy = Yielding(lambda rows: np.full((*np.shape(rows)[:-1], 2), 0.5, np.float32))
    driven = policy(rows)
    assert driven.any(axis=-1).tolist() == [True, False, True]
    np.testing.assert_array_equal(driven, [policy(row) for row in rows])


def test_more_robots_reach_their_goals_among_people():
    """The difference of the shares is over six standard errors here."""
    shares = [evaluate(name, episodes=60, **AMONG).summary()["success"] for name in ("vfh", "vfh+yield")]
    assert shares[0].high < shares[1].low


def test_a_policy_that_stops_for_people_needs_tracks():
    with pytest.raises(ValueError, match=r"with .*scan.*tracks"):
        make_policy("vfh+yield")(np.zeros((2, 50), np.float32))
    with pytest.warns(UserWarning, match=r"vfh\+yield reads tracks, .* noise='wheel'\.$"):  # it gets the term that it names
        chosen = evaluate("vfh+yield", env=ROOMS, world="people", episodes=2)
    assert chosen.config["noise"] == "wheel"
    assert chosen.summary() == evaluate("vfh+yield", episodes=2, **AMONG).summary()
    with pytest.raises(ValueError, match="'tracks' needs wheel odometry"):
        evaluate("vfh+yield", env=ROOMS, world="people", noise="rough", episodes=1)
