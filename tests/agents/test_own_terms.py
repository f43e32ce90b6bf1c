"""A term of one's own is trained with, goes into the bundle by name, and is asked for wherever the bundle drives."""

import numpy as np
import pytest

from turtlebot_gym import Episode
from turtlebot_gym.rooms.scan import Scan
from turtlebot_gym.systems import Options
from turtlebot_gym.values import Covariance, Pose, State
from turtlebot_gym_agents import Deployment
from turtlebot_gym_agents.evaluation.evaluate import evaluate
from turtlebot_gym_agents.policies.bundle import BundlePolicy
from turtlebot_gym_agents.training.config import TrainingConfig
from turtlebot_gym_agents.training.train import train

NAV, ROOMS = "turtlebot_gym/TurtleBotNav-v0", "turtlebot_gym/TurtleBotRooms-v0"
CASES = {
    "bumper": (ROOMS, "ekf,scan*2,own_parts:BUMPER"),
    "speedometer": (NAV, "ekf,own_parts:SPEEDOMETER"),
}


@pytest.fixture(scope="module", params=CASES)
def trained(request, tmp_path_factory):
    """Return a policy after a short training with a term of one's own, and what it was trained with."""
    (env, observation), folder = CASES[request.param], tmp_path_factory.mktemp(request.param)
    small = {"n_envs": 16, "n_timesteps": 512, "policy": "MlpPolicy", "n_steps": 32, "batch_size": 256, "n_epochs": 1}
    config = TrainingConfig(env=env, observation=observation, config=small, evaluations=1, episodes=4)
    train(config, folder / "run", progress=False)
    return request.param, env, observation, folder / "run" / "policy.onnx"


def test_the_card_names_the_terms_and_a_bundle_drives_where_they_are_observed(trained):
    name, env, observation, bundle = trained
    term = BundlePolicy(bundle).card.terms[-1]
    assert (term["name"], term["source"], len(term["low"])) == (name, observation.split(",")[-1], 1)
    summary = evaluate(str(bundle), env=env, observation=observation, episodes=3).summary()
    assert 0.0 <= summary["success"].value <= 1.0
    with pytest.raises(ValueError, match=r"it reads '.*', which is not in the observation .*: name it in observation="):
        evaluate(str(bundle), env=env, episodes=3)


def test_a_deployment_observes_what_the_environment_observes(trained):
    name, env, observation, bundle = trained
    options = {"task": "nav" if env == NAV else "room", "observation": observation, "noise": "tutorial"}
    setup = Options.of(options).setup()
    episode, deployment = Episode(setup.parameters, setup.waypoints, seed=4, system=setup.system), Deployment(bundle)
    assert [term.name for term in deployment.own_terms] == [name]
    for _ in range(20):
        world = episode.world
        (mean, P), course = world.estimate.belief, world.course
        own = {name: world.senses.speedometer if env == NAV else float(world.room.clearance < 0.05)}
        sectors, age = (episode.scene.lidar.sectors.tolist(), world.room.scan_age) if env == ROOMS else ((), 0.0)
        numbers = deployment._numbers(own)
        deployment.command(mean, P, world.estimate.nis, course.reference, course.following, sectors, age, None, numbers)
        np.testing.assert_array_equal(deployment.observation, np.array(episode.observe(), np.float32))
        episode.act(deployment.action.tolist())


def test_a_deployment_refuses_a_term_that_is_missing_by_its_name(trained):
    name, env, _, bundle = trained
    deployment = Deployment(bundle)
    scan = Scan(np.full(360, 2.0, np.float32), 0.0, np.pi / 180.0, 0.12, 3.5) if env == ROOMS else None
    inputs = {"pose": (0, 0, 0), "covariance": (0.01,) * 3, "twist": (0.1, 0.0), "scan": scan, "goal": (1.0, 0.0, 0.0)}
    for own, message in (
        (None, rf"own must have the terms that the policy reads, \['{name}'\], got \[\]"),
        ({name: float("nan")}, f"the term '{name}' must be 1 finite number, got nan"),
        ({name: 0.0, "lamp": 1.0}, rf"reads, \['{name}'\], got \['{name}', 'lamp'\]"),
    ):
        with pytest.raises(ValueError, match=message):
            deployment.act(**inputs, own=own)
    deployment.act(**inputs, own={name: 9.0})
    assert deployment.observation[-1] == np.float32(deployment.own_terms[0].bounds[1][0])


def test_after_a_pause_a_history_begins_anew():
    """What was seen before the robot stood was not seen a step ago."""
    deployment = Deployment(f"{__name__}:remembers")
    seen = []
    for now, v in ((0.1, 0.10), (0.2, 0.12), (0.3, 0.14), (30.0, 0.02), (30.1, 0.04)):
        state, P = State(0.0, 0.0, 0.0, v, 0.0), Covariance(*[0.01] * 8)
        deployment.command(state, P, 0.0, Pose(1.0, 0.0, 0.0), Pose(1.0, 0.0, 0.0), now=now)
        seen.append(deployment.observation[[0, 2]].tolist())
    speeds = [row[0] for row in seen]
    assert [row[1] for row in seen] == [speeds[0], speeds[0], speeds[1], speeds[3], speeds[3]]


def remembers(observations):
    """Stand, by the present twist and the one before."""
    return np.zeros((*observations.shape[:-1], 2), np.float32)


remembers.terms = ("twist*2",)


@pytest.mark.slow
def test_rules_and_their_safety_layer_read_their_terms_in_any_observation():
    options = {"env": ROOMS, "episodes": 6, "seed": 3}
    for name in ("vfh", "vfh+safety", "bearing+safety"):
        plain = evaluate(name, **options)
        other = evaluate(name, observation="own_parts:BUMPER,scan_age,scan*2,next_goal,uncertainty,twist,goal", **options)
        np.testing.assert_array_equal(plain.episodes.time, other.episodes.time)
        np.testing.assert_array_equal(plain.episodes.success, other.episodes.success)
    with pytest.raises(ValueError, match="vfh: it reads 'twist', which is not in the observation goal,scan"):
        evaluate("vfh", observation="goal,scan", **options)
