"""Other libraries' policies whose bundle would lack something, or be none, are refused in one line with the cause."""

import pickle
import shutil
from copy import deepcopy
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import torch

pytest.importorskip("sb3_contrib", reason="needs the extra [dev]")

from foreign import NAV, ON, ROOMS, Agent, deployed, envs_of, exported, library_actions, mlp, normalized, trained
from gymnasium.vector import AutoresetMode
from stable_baselines3 import DQN, PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from turtlebot_gym_agents.policies.bundle import BundlePolicy
from turtlebot_gym_agents.training.export import export
from turtlebot_gym_agents.training.files import read
from turtlebot_gym_agents.training.network import TOLERANCE
from turtlebot_gym_agents.training.sb3_vec_env import Sb3VecEnv

pytestmark = pytest.mark.touched("agents/turtlebot_gym_agents/training", "tests/agents")


class Discrete(gym.ActionWrapper):
    def __init__(self, env):
        super().__init__(env)
        self.action_space = gym.spaces.Discrete(3)

    def action(self, action):
        return np.array([0.5, action - 1.0], np.float32)


def saved(model, folder):
    model.save(folder / "model.zip")
    return folder / "model.zip"


def small(env):
    return PPO("MlpPolicy", env, device="cpu", seed=0, **deepcopy(ON)).learn(64)


def normalized_without_statistics(folder):
    return saved(small(normalized(envs_of())), folder)


def two_statistics(folder):
    trained("normalized", folder, steps=64)
    shutil.copy(folder / "vecnormalize.pkl", folder / "vec_normalize.pkl")
    return folder / "model.zip"


def of_another_task(folder):
    trained("normalized", folder, steps=64)
    VecNormalize(envs_of(ROOMS)).save(folder / "vecnormalize.pkl")
    return folder / "model.zip"


def no_statistics_at_all(folder):
    trained("normalized", folder, steps=64)
    (folder / "vecnormalize.pkl").write_bytes(pickle.dumps({"mean": 0.0}))
    return folder / "model.zip"


def weights_alone(folder):
    torch.save(mlp().state_dict(), folder / "weights.pth")
    return folder / "weights.pth"


def bundle_itself(folder):
    export(mlp(), folder / "bundle.onnx", env=NAV, steps=1)
    return folder / "bundle.onnx"


def agent_without_forward(folder):
    torch.save(Agent(), folder / "agent.pt")
    return folder / "agent.pt"


def in_a_room(folder):
    trained("ppo", folder, env=ROOMS, steps=64)
    return folder / "model.zip"


def wrapped(wrapper):
    return lambda folder: saved(small(DummyVecEnv([lambda: wrapper(gym.make(NAV))] * 2)), folder)


def gymnasium_stack(env):
    return gym.wrappers.FlattenObservation(gym.wrappers.FrameStackObservation(env, 2))


def halved(env):
    return gym.wrappers.RescaleAction(env, np.float32(-0.5), np.float32(0.5))


def scaled(env):
    return gym.wrappers.TransformObservation(env, lambda row: np.float32(100.0) * row, env.observation_space)


REFUSED = {
    "dqn": (lambda folder: saved(DQN("MlpPolicy", Discrete(gym.make(NAV))), folder), "DQN chooses among discrete"),
    "discrete": (wrapped(Discrete), "model of PPO chooses among discrete actions"),
    "actions": (wrapped(halved), r"must have actions \(2,\) in \[-1, 1\]"),
    "no statistics": (normalized_without_statistics, r"needs its statistics, but no vecnormalize\.pkl is beside it"),
    "two statistics": (two_statistics, "several are beside it"),
    "other statistics": (of_another_task, "must hold statistics of 13 observations, .* got 50"),
    "other pickle": (no_statistics_at_all, "must hold statistics of one-dimensional observations.*got dict"),
    "gymnasium's normalization": (wrapped(gym.wrappers.NormalizeObservation), "other bounds than they have"),
    "gymnasium's stack": (wrapped(gymnasium_stack), "other bounds than a stack of them"),
    "scaled": (wrapped(scaled), "last ones it saw are beyond the bounds"),
    "rooms": (in_a_room, "50 are those of .*Rooms-v0"),
    "weights": (weights_alone, "holds weights alone"),
    "bundle": (bundle_itself, "is a policy bundle already"),
    "agent": (agent_without_forward, r"export\(agent\.actor_mean"),
    "nothing": (lambda folder: folder, "must be the folder of a training"),
}


@pytest.mark.sample(5)
@pytest.mark.parametrize("case", REFUSED)
def test_what_a_bundle_would_lack_is_refused_with_the_cause(tmp_path, case):
    make, message = REFUSED[case]
    path = make(tmp_path)
    with pytest.raises(ValueError, match=message) as caught:
        export(path, tmp_path / "policy.onnx", allow_pickle=True, steps=10)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "policy.onnx").exists()


CALLABLES = {
    "several": (lambda o: (o[:, :2], o[:, :2]), "must give actions alone, got 2 values"),
    "chance": (lambda o: o[:, :2] + torch.rand_like(o[:, :2]), "must act reproducibly"),
    "mixed": (lambda o: o[:, :2] - o[:, :2].mean(0), "depend on the others of a batch"),
    "wide": (lambda o: o[:, :4], r"must give actions \(n, 2\), got \(3, 4\)"),
    "fails": (lambda o: o @ torch.zeros(7, 2), "but fails: RuntimeError"),
    "no policy": (3, "model must be a model of Stable-Baselines3, a torch module"),
}


@pytest.mark.parametrize("case", CALLABLES)
def test_a_function_that_is_no_policy_is_refused(tmp_path, case):
    function, message = CALLABLES[case]
    with pytest.raises(ValueError, match=message):
        export(function, tmp_path / "policy.onnx", env=NAV, steps=10)


def test_an_observation_wrapper_of_a_models_own_environment_is_refused(tmp_path):
    with pytest.raises(ValueError, match="trained within TransformObservation, which a bundle does not have"):
        export(small(DummyVecEnv([lambda: scaled(gym.make(NAV))] * 2)), tmp_path / "policy.onnx")


def test_normalization_cannot_be_denied_where_it_shows(tmp_path, capsys):
    trained("normalized", tmp_path, steps=64)
    words = (tmp_path / "model.zip", "--out", tmp_path / "policy.onnx", "--allow-pickle", "--vec-normalize", "none")
    status, said = exported(capsys, *words)
    assert (status, "so vec_normalize cannot be none" in said) == (2, True), said


def test_statistics_beside_a_model_that_was_trained_without_are_left_alone(tmp_path):
    model = trained("ppo", tmp_path, steps=64)
    VecNormalize(envs_of()).save(tmp_path / "vecnormalize.pkl")  # of another model in the same folder
    export(tmp_path / "model.zip", tmp_path / "policy.onnx", allow_pickle=True, steps=100)
    observations, begins, actions = deployed(tmp_path / "policy.onnx", steps=100)
    np.testing.assert_allclose(actions, library_actions(model, observations, begins), rtol=0, atol=TOLERANCE)


@pytest.mark.parametrize("name", ["model.pkl", "model_vecnormalize.pkl", "vec_normalize.pkl", "rl_vecnormalize_64_steps.pkl"])
def test_statistics_are_found_by_their_usual_names(tmp_path, name):
    trained("normalized", tmp_path, steps=64)
    zipped = "rl_64_steps.zip" if name.startswith("rl") else "model.zip"
    shutil.move(tmp_path / "vecnormalize.pkl", tmp_path / name)
    shutil.move(tmp_path / "model.zip", tmp_path / zipped)
    assert read(tmp_path / zipped, allow_pickle=True).statistics == (tmp_path / name,)


def test_an_unknown_environment_is_refused_with_the_known_ones(tmp_path):
    with pytest.raises(ValueError, match=r"env must be one of .*TurtleBotNav-v0.*got 'turtlebot_gym/NoSuch-v0'"):
        export(mlp(), tmp_path / "policy.onnx", env="turtlebot_gym/NoSuch-v0")


def test_nothing_pickled_is_loaded_without_consent(tmp_path):
    trained("normalized", tmp_path, steps=64)
    torch.save(Agent(), tmp_path / "agent.pt")
    for name in ("model.zip", "agent.pt"):
        with pytest.raises(ValueError, match="add --allow-pickle"):
            export(tmp_path / name, tmp_path / "policy.onnx")
    with pytest.raises(ValueError, match="add --allow-pickle"):
        export(mlp(), tmp_path / "policy.onnx", env=NAV, vec_normalize=tmp_path / "vecnormalize.pkl")


def test_a_model_of_the_native_environment_knows_where_it_was_trained(tmp_path):
    pose = "turtlebot_gym/TurtleBotPose-v0"
    envs = gym.make_vec(pose, num_envs=4, autoreset_mode=AutoresetMode.SAME_STEP, robot="waffle", noise="rough")
    export(small(normalized(Sb3VecEnv(envs))), tmp_path / "policy.onnx", steps=100)
    card = BundlePolicy(tmp_path / "policy.onnx").card
    assert (card.env, card.robot["name"], card.noise) == (pose, "waffle", "rough")
    assert card.training["normalized"]
    assert Path(tmp_path / "policy.onnx").is_file()
