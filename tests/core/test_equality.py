"""What is trained is what is deployed: plain Python and every row of a vector environment agree to the last bit.

The reference is the transition as plain Python on floats, driven by the actions that a vector environment was given. The scalar
environment is compared with both in `tests/golden`.
"""

from __future__ import annotations

from dataclasses import replace

import gymnasium as gym
import numba
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import turtlebot_gym
from turtlebot_gym.parameters import Kalman
from turtlebot_gym.systems import Episode, Options

STEPS, SEED, LIMIT = 1000, 7, 150
NEXT_STEP, SAME_STEP, DISABLED = AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP, AutoresetMode.DISABLED

SHAKY = turtlebot_gym.Noise(
    process=turtlebot_gym.ProcessNoise(
        alpha1=0.02, alpha2=0.001, alpha3=0.05, alpha4=0.01, slip=0.5, slip_start=0.05, slip_end=0.2
    ),
    odometry=turtlebot_gym.OdometryNoise(
        R=(0.01, 0.02, 0.03), bias=(0.02, -0.01, 0.03), spike_probability=0.1, spike=0.5, dropout_probability=0.1,
        quantization=(0.005, 0.01),
    ),
)  # fmt: skip
"""Every kind of error at once."""
GATED = turtlebot_gym.FilterTuning(
    Q=(1e-4, 1e-4, 1e-4, 1e-3, 1e-3), R=(0.01, 0.02, 0.03), process=SHAKY.process, kind=Kalman(gate=9.0, max_rejections=2)
)
"""A gate that is often shut, and often enough for a restart."""

HEAVY = turtlebot_gym.Robot(
    max_linear=0.3, max_angular=1.9, max_wheel=0.306, max_linear_acceleration=0.9, max_angular_acceleration=7.0
)

CASES = {
    "nav": {"task": "nav"},
    "pose, everything noisy": {"task": "pose", "noise": SHAKY, "filter": GATED, "integrator": "midpoint", "arrival": "belief"},
    "square by time": {"task": "square", "noise": "documented", "filter": "tutorial", "switch": "time", "robot": "tutorial"},
    "square twice, on wheels": {"task": "square", "noise": "wheel", "laps": 2, "dt": 0.2, "robot": "turtlebot4"},
    "heavy and late": {"task": "nav", "noise": "rough", "robot": HEAVY, "delay": 2, "integrator": "midpoint"},
    "odometry shown": {"task": "nav", "noise": "rough", "observation": "odometry"},
    "truth shown": {"task": "nav", "noise": "clean", "observation": "truth", "integrator": "midpoint"},
}
KINDS = {kind: {"task": "nav", "noise": SHAKY, "filter": kind} for kind in ("gated", "mixture", "slip", "scale")}
LATE = turtlebot_gym.FixNoise(R=(0.01, 0.02, 0.03), period=0.4, delay=0.2, dropout_probability=0.3)
KINDS["wheels and late fixes"] = {"task": "nav", "noise": "wheel", "fix": LATE}
KINDS["spikes and fixes in time"] = {"task": "nav", "noise": SHAKY, "filter": "mixture", "fix": "beacons"}
CASES |= KINDS
IDS = {
    "nav": "turtlebot_gym/TurtleBotNav-v0",
    "pose": "turtlebot_gym/TurtleBotPose-v0",
    "square": "turtlebot_gym/TurtleBotSquare-v0",
}


def plain_episode(*, limit, seed, **options):
    """Return the case as an environment in plain Python: no arrays, no compiled code."""
    parameters, waypoints, *_ = Options(**options).setup()
    return Episode(parameters._replace(task=replace(parameters.task, max_steps=limit)), waypoints, seed=seed)


def row_of(episode):
    """Return all that there is to compare of an episode, as numbers in a fixed order."""
    w, outcome = episode.world, episode.outcome
    belief = w.estimate.belief
    parts = (
        *w.body.true_state,
        *w.senses.odometry.pose,
        *belief.mean,
        *belief.covariance,
        *w.course.reference,
        *w.body.command,
    )
    observation = np.array(episode.observe(), np.float32)
    judged = (outcome.reward, outcome.terminated, outcome.truncated, outcome.is_success, outcome.distance)
    return np.array([*observation, *judged, *parts], np.float64)


def begun(episode):
    """Begin the next episode, and return its first row."""
    episode.reset()
    return row_of(episode)


def acted(episode, action):
    """Advance by an action, and return the row that it leads to."""
    episode.act(action)
    return row_of(episode)


def rows(observations, rewards, terminated, truncated, infos):
    """Return what a vector environment gave, a row per environment, in the order of `row_of`."""
    upper = np.triu_indices(5)
    covariance = infos["covariance"][:, upper[0], upper[1]]
    parts = [infos["true_state"], infos["odometry"], infos["estimate"], covariance, infos["reference"], infos["command"]]
    columns = [rewards, terminated, truncated, infos["is_success"], infos["distance"]]
    return np.hstack([observations.astype(np.float64), np.column_stack(columns).astype(np.float64), *parts])


def drive(observations, rng):
    """Return noisy actions that often arrive, sometimes leave the action space, and differ from row to row."""
    distance, cosine, sine, cos_turn, sin_turn = observations.T[:5]
    bearing, turn = np.arctan2(sine, cosine), np.arctan2(sin_turn, cos_turn)
    close = distance < 0.12
    actions = np.column_stack([np.where(close, 0.0, cosine), np.where(close, 0.5 * turn, 1.5 * bearing)])
    return (actions + np.where(close, 0.05, 0.5)[:, None] * rng.normal(size=actions.shape)).astype(np.float32)


def record(case, mode, num_envs, watched, steps=STEPS):
    """Drive a vector environment; return its actions (T, W, 2), rows (T + 1, W, .) and final rows by (time, watched)."""
    options = dict(CASES[case])
    limit = 400 if options["task"] == "square" and not options.get("switch") else LIMIT
    env = gym.make_vec(
        IDS[options.pop("task")], num_envs=num_envs, max_episode_steps=limit, autoreset_mode=mode, info="full", **options
    )
    rng = np.random.default_rng(0)
    observations, infos = env.reset(seed=SEED)
    nothing = np.zeros(num_envs)
    log, actions, finals = [rows(observations, nothing, nothing, nothing, infos)[watched]], [], {}
    for t in range(steps):
        actions.append(drive(observations, rng))
        observations, rewards, terminated, truncated, infos = env.step(actions[-1])
        log.append(rows(observations, rewards, terminated, truncated, infos)[watched])
        actions[-1] = actions[-1][watched]
        if mode is SAME_STEP and "final_obs" in infos:
            last = np.stack([observations[0] if row is None else row for row in infos["final_obs"]])
            last = rows(last, rewards, terminated, truncated, infos["final_info"])[watched]
            finals |= {(t, row): last[row] for row in np.flatnonzero(infos["_final_obs"][watched])}
        done = terminated | truncated
        if mode is DISABLED and done.any():
            observations, infos = env.reset(options={"reset_mask": done})
            again = rows(observations, nothing, nothing, nothing, infos)[watched]
            finals |= {(t, row): again[row] for row in np.flatnonzero(done[watched])}
    env.close()
    return np.array(actions), np.array(log), finals, limit


def compare(case, mode, watched, actions, log, finals, limit):
    """Replay the actions in plain Python and compare every number; return how often an episode ended in each way."""
    ends = np.zeros(2, int)
    for column, row in enumerate(watched):
        plain = plain_episode(limit=limit, seed=SEED + int(row), **CASES[case])
        expected = row_of(plain)
        done = False
        np.testing.assert_array_equal(log[0, column], expected)
        for t, action in enumerate(actions[:, column]):
            if mode is NEXT_STEP and done:
                expected, done = begun(plain), False
            else:
                expected = acted(plain, action)
                done = bool(expected[14] or expected[15])
                ends += [expected[14] != 0, expected[15] != 0]
            if mode is SAME_STEP and done:
                np.testing.assert_array_equal(finals[t, column], expected, err_msg=f"final, step {t}, row {row}")
                reward_and_ends = expected[13:16]
                expected = begun(plain)
                expected[13:16] = reward_and_ends
            np.testing.assert_array_equal(log[t + 1, column], expected, err_msg=f"step {t}, row {row}")
            if mode is DISABLED and done:
                np.testing.assert_array_equal(finals[t, column], begun(plain), err_msg=f"reset, step {t}, row {row}")
    return ends


@pytest.mark.parametrize("mode", AutoresetMode)
@pytest.mark.parametrize("case", [case for case in CASES if case not in KINDS])
def test_rows_equal_plain_python(case, mode):
    watched = np.arange(7)
    ends = compare(case, mode, watched, *record(case, mode, 7, watched))
    assert ends[0] > 0 or CASES[case].get("switch") == "time", "no episode terminated: the test saw too little"
    assert ends[1] > 0 or CASES[case].get("laps") == 2, "no episode was truncated: the test saw too little"


@pytest.mark.parametrize("mode", AutoresetMode)
@pytest.mark.parametrize("case", ["nav", "pose, everything noisy"])
def test_a_batch_of_one_equals_plain_python(case, mode):
    watched = np.arange(1)
    compare(case, mode, watched, *record(case, mode, 1, watched))


@pytest.mark.parametrize("kind", KINDS)
def test_rows_with_each_kind_of_filter_equal_plain_python(kind):
    watched = np.arange(3)
    assert compare(kind, NEXT_STEP, watched, *record(kind, NEXT_STEP, 3, watched, steps=400))[1] > 0


@pytest.fixture
def threads():
    """Let a test choose numba's number of threads, and put it back."""
    before = numba.get_num_threads()
    yield numba.set_num_threads
    numba.set_num_threads(before)


@pytest.mark.parametrize("n_threads", [1, 2])
@pytest.mark.parametrize("mode", AutoresetMode)
def test_a_large_batch_equals_plain_python_on_any_number_of_threads(mode, n_threads, threads):
    if n_threads > numba.config.NUMBA_NUM_THREADS:
        pytest.skip(f"numba has {numba.config.NUMBA_NUM_THREADS} thread(s) here")
    threads(n_threads)
    watched = np.array([0, 31, 32, 2047, 2048, 4095])  # both sides of a tile's and of the threads' border
    compare("pose, everything noisy", mode, watched, *record("pose, everything noisy", mode, 4096, watched))
