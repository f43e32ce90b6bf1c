"""What the viewer receives: episodes and recorded drives with their surroundings."""

import gymnasium as gym
import numpy as np
import pytest

import turtlebot_gym  # noqa: F401
from turtlebot_gym.drive import position_error
from turtlebot_gym_agents.evaluation.evaluate import evaluate
from turtlebot_gym_agents.evaluation.recording import record_episode
from turtlebot_gym_agents.policies import make_policy
from turtlebot_gym_view.command import read_recorded

NAV, ROOMS = "turtlebot_gym/TurtleBotNav-v0", "turtlebot_gym/TurtleBotRooms-v0"


def stand(observations):
    return np.zeros((*observations.shape[:-1], 2), np.float32)


def drive(env, policy, seed, **options):
    """Return the infos of the scalar environment's episode, at the start and after each step."""
    world = gym.make(env, **options)
    observation, info = world.reset(seed=seed)
    policy, infos, ended = make_policy(policy), [info], False
    while not ended:
        observation, _, terminated, truncated, info = world.step(policy(observation[None])[0])
        infos.append(info)
        ended = terminated or truncated
    world.close()
    return infos


@pytest.mark.parametrize(("env", "policy", "options"), [(NAV, "bearing", {"noise": "documented"}), (ROOMS, "vfh", {})])
def test_it_holds_the_numbers_of_the_scalar_environment(env, policy, options):
    recorded, infos = record_episode(policy, env=env, seed=3, **options), drive(env, policy, 3, **options)
    assert len(recorded) == len(infos)
    np.testing.assert_allclose(recorded.time, 0.1 * np.arange(len(infos)))
    for name in ("true_state", "odometry", "estimate", "covariance", "reference", "command"):
        np.testing.assert_array_equal(getattr(recorded, name), [info[name] for info in infos], err_msg=name)
    if env == ROOMS:
        np.testing.assert_array_equal(recorded.clearance, [info["clearance"] for info in infos])
    else:
        assert np.isnan(recorded.clearance).all()
        assert recorded.around.room is None
        assert not recorded.scans
    assert recorded.nis[0] == 0.0
    assert np.all(recorded.nis[1:] > 0.0)


def test_it_is_the_first_episode_of_an_evaluation():
    evaluation = evaluate("bearing", episodes=1, seed=5)
    recorded = record_episode("bearing", seed=5)
    assert evaluation.episodes.success[0]
    assert recorded.outcome == f"success after {evaluation.episodes.time[0]:.1f} s"
    assert record_episode(stand, seed=5, label="nobody").around.label == "nobody"
    assert record_episode(stand, seed=5).outcome.startswith("time is up")


def test_a_drive_records_when_fixes_arrived():
    recorded = record_episode("bearing", seed=2, noise="wheel", fix="beacons")
    np.testing.assert_allclose(recorded.time[recorded.fix > 0], np.arange(0.5, recorded.time[-1] + 0.01, 0.5))
    assert not np.isfinite(record_episode("bearing", seed=2, noise="wheel").fix).any()


def test_a_drive_has_the_tracks_that_the_policy_observes():
    options = {"world": "people", "noise": "wheel", "observation": "ekf,tracks"}
    recorded = record_episode(stand, env=ROOMS, seed=2, **options)
    world = gym.make(ROOMS, **options)
    observed = [world.reset(seed=2)[0]]
    while len(observed) < len(recorded):
        observed.append(world.step(np.zeros(2, np.float32))[0])
    world.close()
    np.testing.assert_array_equal(recorded.tracks.reshape(len(recorded), -1), np.array(observed)[:, -40:])
    assert (recorded.tracks[:, :, -1] == 1.0).sum() > len(recorded)
    assert np.isnan(record_episode(stand, env=ROOMS, seed=2, world="people", noise="wheel").tracks).all()


def test_a_localizer_in_doubt_shows_its_hypotheses_and_its_map():
    drive = record_episode("vfh", env=ROOMS, seed=4, world="office", localizer="match", noise="wheel", start="unknown")
    doubts = [row for row, places in enumerate(drive.hypotheses) if len(places)]
    assert doubts
    assert doubts[-1] < len(drive) - 1
    for row in doubts:
        places = drive.hypotheses[row]
        assert 0.0 < places[:, 3].sum() <= 1.0 + 1e-9
        assert position_error(places, drive.estimate[row]).min() < 0.3  # the best of them is the belief
    true = position_error(drive.hypotheses[doubts[0]], drive.true_state[doubts[0]])
    assert true.min() < 0.3
    walls = drive.around.chart.walls()
    np.testing.assert_allclose(walls, np.add(drive.around.room.walls, [0.0, 0.0, 0.05, 0.05]), atol=0.03)
    known = record_episode("vfh", env=ROOMS, seed=4, world="office")
    assert known.around.chart is None
    assert not any(map(len, known.hypotheses))


@pytest.mark.parametrize("names", ["vx,gyro,px,py,theta", "v,omega,x,y,theta"])
def test_a_drive_without_measured_poses_is_replayed_and_another_one_shown_as_it_is(names, tmp_path):
    rows = [f"{0.1 * k:.1f},0.2,0.0,{0.02 * k:.2f},0.0,0.0" for k in range(30)]
    (tmp_path / "drive.csv").write_text("\n".join([f"t,{names}", *rows]))
    drive = read_recorded(tmp_path / "drive.csv", label="mine", noise="clean")
    assert drive.around.label == "mine"
    if names.startswith("vx"):
        np.testing.assert_allclose(drive.true_state[:, 0], 0.02 * np.arange(30), atol=1e-9)
        np.testing.assert_allclose(drive.estimate[:, 0], drive.true_state[:, 0], atol=1e-3)
        assert np.isfinite(drive.odometry).all()
    else:
        np.testing.assert_allclose(drive.odometry[:, 0], 0.02 * np.arange(30), atol=1e-9)
        assert np.isnan(drive.estimate).all()
