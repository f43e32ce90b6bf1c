"""Observations are made of named terms: the package's, one's own, and histories of both, the same wherever a robot drives."""

import json

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from turtlebot_gym import Episode, ObservationTerm
from turtlebot_gym.observations import LOCATED_ROOM, OPEN_GROUND, ROOM
from turtlebot_gym.observations.columns import bounds_of, columns_of, size_of, slices_of
from turtlebot_gym.systems import Options

NAV, ROOMS, MISSIONS = (f"turtlebot_gym/TurtleBot{task}-v0" for task in ("Nav", "Rooms", "Missions"))
LOCALIZED = {"world": "office", "noise": "wheel", "localizer": "match"}
OBSERVED = {
    "a speedometer": (NAV, "ekf,own_parts:SPEEDOMETER", {}, 14),
    "terms in another order": (ROOMS, "scan_age,scan*2@2,goal,twist*3,own_parts:BUMPER*2", {}, 1 + 72 + 5 + 6 + 2),
    "a term of the room": (MISSIONS, "located,own_parts:GAPS", LOCALIZED, 56),
    "a few": (NAV, ["goal", "twist"], {"noise": "rough", "filter": "gated"}, 7),
}


@pytest.mark.parametrize(
    "case", [pytest.param(case, marks=[pytest.mark.slow] * ("room" in case or "order" in case)) for case in OBSERVED]
)
def test_an_observation_is_the_same_in_scalar_vector_and_plain_environments(case):
    """Through an episode's end and the next one's start, where a history begins anew."""
    id, observation, options, size = OBSERVED[case]
    options = {**options, "observation": observation}
    scalar = gym.make(id, max_episode_steps=25, **options)
    many = gym.make_vec(id, num_envs=3, max_episode_steps=25, autoreset_mode="SAME_STEP", **options)
    task = {NAV: "nav", ROOMS: "room", MISSIONS: "mission"}[id]
    setup = Options.of({"task": task, **options}).setup()
    episode = Episode(setup.parameters, setup.waypoints, seed=3, system=setup.system)
    (observed, _), (rows, _) = scalar.reset(seed=3), many.reset(seed=3)
    low, high = np.array(bounds_of(scalar.unwrapped.observation_terms), np.float32)
    for step in range(40):
        assert observed.shape == low.shape == (size,)
        assert ((low <= observed) & (observed <= high)).all()
        np.testing.assert_array_equal(rows[0], observed)
        np.testing.assert_array_equal(np.array(episode.observe(), np.float32), observed)
        action = np.array([0.7, 0.5 * np.sin(step)], np.float32)
        observed, _, terminated, truncated, _ = scalar.step(action)
        rows, *_, infos = many.step(np.tile(action, (3, 1)))
        episode.act(action.tolist())
        if terminated or truncated:
            np.testing.assert_array_equal(infos["final_obs"][0], observed)
            observed, _ = scalar.reset()
            episode.reset()


def test_a_history_shows_what_was_seen_before_and_at_first_the_first():
    env = gym.make(NAV, observation="ekf,twist*3@2")
    place, seen = slices_of(env.unwrapped.observation_terms)["twist"], []
    observed, _ = env.reset(seed=2)
    for step in range(12):
        now, before, first = observed[place].reshape(3, 2)
        seen.append(now)
        np.testing.assert_array_equal(before, seen[max(step - 2, 0)])
        np.testing.assert_array_equal(first, seen[max(step - 4, 0)])
        observed, *_ = env.step(np.array([1.0, 0.3 * step - 1.0], np.float32))
    assert len({tuple(row.tolist()) for row in seen}) > 6


def test_an_environment_with_own_terms_passes_gymnasiums_checks_and_is_made_again():
    env = gym.make(NAV, observation="ekf,own_parts:SPEEDOMETER")
    check_env(env.unwrapped, skip_render_check=True)
    again = gym.make(gym.envs.registration.EnvSpec.from_json(env.spec.to_json()))
    assert json.loads(env.spec.to_json())["kwargs"]["observation"] == "ekf,own_parts:SPEEDOMETER"
    np.testing.assert_array_equal(env.reset(seed=5)[0], again.reset(seed=5)[0])


@pytest.mark.parametrize(
    ("id", "observation", "message"),
    [
        (NAV, "ekf,scan", "observation 'scan' needs a room: choose one with world="),
        (NAV, "ekf,odometry", "observation must be terms with one pose, got 'ekf,odometry'"),
        (NAV, "ekf,twsit", "a term of observation .* must be .* Did you mean 'twist'?"),
        (NAV, "ekf,goal", "observation has the term 'goal' twice"),
        (NAV, "ekf,json:dumps", "observation 'json:dumps' must be a turtlebot_gym.observations.ObservationTerm"),
        (ROOMS, "scan", "observation must have a term beside 'scan'"),
        (ROOMS, "ekf,own_parts:SHORT", "the term 'short' has bounds of 2 numbers, but its kernel returns 1"),
        (NAV, "ekf,twist*101", "length must be a whole number from 1 to 100, got 101"),
    ],
)
def test_an_observation_that_cannot_be_is_refused_in_one_line(id, observation, message):
    with pytest.raises(ValueError, match=message) as refused:
        gym.make(id, observation=observation)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("bounds", [(1.0, 0.0), ((0.0, 0.0), 1.0), (0.0, float("inf"))])
def test_a_term_has_bounds_and_one_with_others_is_not_taken_for_it(bounds):
    with pytest.raises(ValueError, match="low must be up to 100 finite numbers, each below"):
        ObservationTerm("bumper", len, *bounds)
    with pytest.raises(ValueError, match="it reads 'goal' with other bounds or another unit"):
        columns_of((ObservationTerm("goal", len, (0.0,) * 5, (1.0,) * 5),), ROOM)


def test_terms_are_found_by_name_wherever_they_stand():
    assert (size_of(OPEN_GROUND), size_of(ROOM), size_of(LOCATED_ROOM)) == (13, 50, 54)
    assert columns_of(ROOM, LOCATED_ROOM).tolist() == [*range(13), *range(17, 54)]
    stacked = (ROOM[4].over(2), ROOM[0])
    assert columns_of((ROOM[0], ROOM[4]), stacked).tolist() == [*range(72, 77), *range(36)]
    for wanted in (ROOM, (ROOM[4].over(3),), (ROOM[4].over(2, every=2),)):
        with pytest.raises(ValueError, match=r"it reads '.*', which is not in the observation scan"):
            columns_of(wanted, stacked)


@pytest.mark.parametrize("rows", [1, 20])
def test_a_term_that_cannot_be_compiled_lets_all_run_as_plain_python_with_the_same_bits(rows):
    plain, compiled = (gym.make_vec(NAV, num_envs=rows, observation=named) for named in ("ekf,own_parts:WRITTEN", "ekf"))
    with pytest.warns(RuntimeWarning, match="run as plain Python"):
        seen = plain.reset(seed=3)[0]
    shown = compiled.reset(seed=3)[0]
    for action in np.random.default_rng(0).uniform(-1.0, 1.0, (20, rows, 2)).astype(np.float32):
        np.testing.assert_array_equal(seen[:, :-1], shown)
        np.testing.assert_array_equal(seen[:, -1], plain.unwrapped._batch.numbers("body.true_state")[:, 3].astype(np.float32))
        seen, shown = plain.step(action)[0], compiled.step(action)[0]
