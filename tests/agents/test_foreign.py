"""Other libraries' policies: their bundles act as they do, with all that they were trained with, or are refused."""

import pickle
import shutil
from copy import deepcopy
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import torch
import yaml

pytest.importorskip("sb3_contrib", reason="needs the extra [dev]")

from foreign import KINDS, NAV, ON, ROOMS, SMALL, deployed, envs_of, library_actions, normalized, torch_actions, trained
from gymnasium.vector import AutoresetMode
from stable_baselines3 import DQN, PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize
from torch import nn

from turtlebot_gym_agents.commands.cli import main
from turtlebot_gym_agents.policies.bundle import BundlePolicy
from turtlebot_gym_agents.training.config import TrainingConfig
from turtlebot_gym_agents.training.export import export
from turtlebot_gym_agents.training.files import read
from turtlebot_gym_agents.training.network import TOLERANCE
from turtlebot_gym_agents.training.train import train

DAILY = ("ppo", "normalized", "normalized-stack", "recurrent-normalized-stack")
"""Kinds whose training and export take a second or two; the others run nightly."""


def bundle_actions(bundle, observations, begins):
    policy, actions = BundlePolicy(bundle), []
    for observation, begin in zip(observations, begins, strict=True):
        if begin and policy.memory:
            policy.reset(np.ones((), np.bool_))
        actions.append(policy(observation))
    return np.array(actions)


def close(actions, expected):
    np.testing.assert_allclose(actions, expected, rtol=0, atol=TOLERANCE)
    assert np.std(expected, axis=0).min() > 1e-3  # a constant would be easy to equal


@pytest.mark.parametrize("kind", [kind if kind in DAILY else pytest.param(kind, marks=pytest.mark.nightly) for kind in KINDS])
def test_a_model_acts_in_its_bundle_and_deployment_as_in_its_library(tmp_path, kind):
    model = trained(kind, tmp_path)
    export(tmp_path / "model.zip", tmp_path / "file.onnx", env=NAV, allow_pickle=True)
    observations, begins, actions = deployed(tmp_path / "file.onnx")
    expected = library_actions(model, observations, begins)
    close(actions, expected)
    close(bundle_actions(tmp_path / "file.onnx", observations, begins), expected)
    if kind == "normalized":  # the same from the object
        export(model, tmp_path / "object.onnx", steps=50)
        close(bundle_actions(tmp_path / "object.onnx", observations, begins), expected)


# Folders and command lines.


def exported(capsys, *words):
    status = main(["export", *map(str, words)])
    output = capsys.readouterr()
    return status, " ".join((output.out + output.err).split())


def test_the_best_model_of_a_training_in_rooms_is_exported_by_its_folder(tmp_path, capsys):
    hyper = {"n_envs": 8, "n_timesteps": 256, "n_steps": 16, "batch_size": 64, "policy_kwargs": SMALL}
    config = TrainingConfig(env=ROOMS, world="office", config=hyper, evaluations=1, episodes=4, steps=256, randomize=True)
    train(config, tmp_path / "run", progress=False)
    status, said = exported(capsys, tmp_path / "run", "--out", tmp_path / "rooms.onnx", "--allow-pickle")
    assert (status, "differ from the library's by at most" in said) == (0, True), said
    (again, theirs) = (BundlePolicy(path) for path in (tmp_path / "rooms.onnx", tmp_path / "run" / "policy.onnx"))
    assert (again.terms, again.card.env, again.card.noise) == (theirs.terms, ROOMS, "randomized")
    rows = np.random.default_rng(0).uniform(0.0, 1.0, (50, 50))
    np.testing.assert_array_equal(again(rows), theirs(rows))


@pytest.mark.nightly  # the kernels of these terms are compiled
def test_own_terms_and_a_history_go_on_the_card(tmp_path):
    options = {"observation": "goal,twist,uncertainty,scan*2", "world": "clutter", "robot": "waffle", "dt": 0.2}
    trained("ppo", tmp_path, env=ROOMS, steps=128, **options)
    export(tmp_path / "model.zip", tmp_path / "policy.onnx", env=ROOMS, allow_pickle=True, steps=50, **options)
    policy = BundlePolicy(tmp_path / "policy.onnx", robot="waffle", dt=0.2)
    assert [term.spelled for term in policy.terms] == ["goal", "twist", "uncertainty", "scan*2"]


def zoo_run(folder, *, hyper=None, **env_kwargs):
    """Lay out a run as rl-baselines3-zoo does: RUN/ENV.zip, and RUN/ENV/ with args.yml, config.yml and vecnormalize.pkl.

    References:
        DLR-RM, rl-baselines3-zoo, rl_zoo3/exp_manager.py, `_save_config` and `save_trained_model`.
    """
    from collections import OrderedDict

    env = NAV.replace("/", "-")
    run, inner = folder / "ppo" / f"{env}_1", folder / "ppo" / f"{env}_1" / env
    inner.mkdir(parents=True)
    model = trained("normalized", folder, **env_kwargs)
    shutil.move(folder / "model.zip", run / f"{env}.zip")
    shutil.move(folder / "vecnormalize.pkl", inner / "vecnormalize.pkl")
    content = OrderedDict(n_envs=2, n_timesteps=256.0, normalize=True, policy="MlpPolicy", **hyper or {})
    (inner / "config.yml").write_text(yaml.dump(content))
    (inner / "args.yml").write_text(yaml.dump(OrderedDict(algo="ppo", env=NAV, env_kwargs=env_kwargs or None, seed=3)))
    return model, run


@pytest.mark.parametrize("named", ["folder", pytest.param("zip", marks=pytest.mark.nightly)])
def test_a_run_of_rl_baselines3_zoo(tmp_path, capsys, named):
    model, run = zoo_run(tmp_path, robot="waffle")
    file = run if named == "folder" else run / f"{run.name.removesuffix('_1')}.zip"
    status, said = exported(capsys, file, "--out", tmp_path / "zoo.onnx", "--allow-pickle")
    assert (status, "with normalization" in said) == (0, True), said
    assert BundlePolicy(tmp_path / "zoo.onnx").card.robot["name"] == "waffle"
    observations, begins, actions = deployed(tmp_path / "zoo.onnx", steps=100)
    close(actions, library_actions(model, observations, begins))


def test_a_wrapper_of_rl_baselines3_zoo_is_refused(tmp_path, capsys):
    _, run = zoo_run(tmp_path, hyper={"env_wrapper": "rl_zoo3.wrappers.TimeFeatureWrapper"})
    status, said = exported(capsys, run, "--out", tmp_path / "zoo.onnx", "--allow-pickle")
    assert (status, "env_wrapper 'rl_zoo3.wrappers.TimeFeatureWrapper' changes what the model sees" in said) == (2, True), said


# Networks without a library's model around them.


def mlp(outputs=2):
    torch.manual_seed(0)
    return nn.Sequential(nn.Linear(13, 16), nn.Tanh(), nn.Dropout(0.5), nn.Linear(16, outputs)).eval()


def as_module(network, path):
    torch.save(network, path)


def as_torch_script(network, path):
    torch.jit.script(network).save(path)


def as_onnx(network, path, *, rows=True, **more):
    axes = {"dynamic_axes": {"obs": {0: "n"}}} if rows else {}
    names = {"input_names": ["obs"], "output_names": ["action"]} | more
    torch.onnx.export(network, (torch.zeros(1, 13),), path, dynamo=False, **names, **axes)


FILES = {
    "module.pt": as_module,
    "script.pt": as_torch_script,
    "rows.onnx": as_onnx,
    "one.onnx": lambda network, path: as_onnx(network, path, rows=False),
}


@pytest.mark.parametrize("name", FILES)
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_networks_file_acts_in_its_bundle_as_in_torch(tmp_path, capsys, name):
    network = mlp()
    FILES[name](network, tmp_path / name)
    words = ["--env", NAV, "--robot", "waffle", "--noise", "rough", "--rate", "20", "--observation", "odometry"]
    pickled = [] if name.endswith("onnx") else ["--allow-pickle"]
    status, said = exported(capsys, tmp_path / name, "--out", tmp_path / "out.onnx", *words, *pickled)
    assert status == 0, said
    card = BundlePolicy(tmp_path / "out.onnx", robot="waffle", dt=0.05).card
    assert (card.env, card.noise, card.observation) == (NAV, "rough", "odometry")
    observations, _, actions = deployed(tmp_path / "out.onnx")
    close(actions, torch_actions(network, observations))


@pytest.mark.parametrize("name", ["module.pt", "one.onnx"])
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_statistics_beside_a_network_must_be_named_or_denied(tmp_path, capsys, name):
    FILES[name](network := mlp(), tmp_path / name)
    statistics = VecNormalize(envs_of(count=1))
    statistics.obs_rms.mean, statistics.obs_rms.var = np.linspace(-1.0, 1.0, 13), np.linspace(1e-9, 4.0, 13)
    statistics.save(tmp_path / "vecnormalize.pkl")
    words = [tmp_path / name, "--out", tmp_path / "out.onnx", "--allow-pickle"]
    status, said = exported(capsys, *words)
    assert (status, "--vec-normalize none" in said) == (2, True), said
    status, said = exported(capsys, *words, "--vec-normalize", tmp_path / "vecnormalize.pkl")
    assert (status, "with normalization" in said) == (0, True), said
    observations, _, actions = deployed(tmp_path / "out.onnx", steps=100)
    close(actions, torch_actions(network, statistics.normalize_obs(observations)))


class Agent(nn.Module):
    """The structure of CleanRL's agents (ppo_continuous_action.py): no forward, but named parts."""

    def __init__(self):
        super().__init__()
        self.critic, self.actor_mean, self.actor_logstd = mlp(1), mlp(), nn.Parameter(torch.zeros(1, 2))


def test_an_agent_of_cleanrl_with_its_normalization_of_gymnasium(tmp_path):
    agent, envs = Agent(), gym.wrappers.NormalizeObservation(gym.make(NAV))
    envs.reset(seed=0)
    for _ in range(300):
        envs.step(envs.action_space.sample())
    clipped = lambda observation: agent.actor_mean(observation.clamp(-10.0, 10.0))  # noqa: E731
    export(clipped, tmp_path / "policy.onnx", env=NAV, vec_normalize=envs)
    observations, _, actions = deployed(tmp_path / "policy.onnx")
    envs.update_running_mean = False
    seen = np.clip([envs.observation(row) for row in observations], -10.0, 10.0)
    close(actions, torch_actions(agent.actor_mean, seen.astype(np.float32)))


class Model(nn.Module):
    """The structure of skrl's models: ``compute`` on a dictionary, and a scaler of observations (RunningStandardScaler)."""

    def __init__(self):
        super().__init__()
        self.net, self.mean, self.std = mlp(), torch.linspace(-1.0, 1.0, 13), torch.linspace(0.5, 2.0, 13)

    def compute(self, inputs, role):
        return self.net(inputs["observations"]), {"log_std": torch.zeros(2)}

    def scale(self, observations):
        return torch.clamp((observations - self.mean) / self.std, -5.0, 5.0)


def test_an_agent_of_skrl_with_its_preprocessor(tmp_path):
    agent = Model()
    acting = lambda observation: agent.compute({"observations": agent.scale(observation)}, "policy")[0]  # noqa: E731
    export(acting, tmp_path / "policy.onnx", env=NAV)
    observations, _, actions = deployed(tmp_path / "policy.onnx")
    close(actions, torch_actions(acting, observations))


class Recurrent(nn.Module):
    def __init__(self):
        super().__init__()
        torch.manual_seed(0)
        self.cell, self.head = nn.GRUCell(13, 8), nn.Linear(8, 2)

    def forward(self, observation, memory):
        memory = self.cell(observation, memory)
        return self.head(memory), memory


def test_a_network_with_a_state(tmp_path):
    network = Recurrent().eval()
    export(network, tmp_path / "policy.onnx", env=NAV, memory=8)
    observations, begins, actions = deployed(tmp_path / "policy.onnx")
    memory, expected = torch.zeros(1, 8), []
    for observation, begin in zip(observations, begins, strict=True):
        with torch.no_grad():
            action, memory = network(torch.from_numpy(observation)[None], memory * (not begin))
        expected.append(np.clip(action[0].numpy(), -1.0, 1.0))
    close(actions, np.array(expected))


# What is refused, by its cause.


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
    close(actions, library_actions(model, observations, begins))


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
    from turtlebot_gym_agents.training.sb3_vec_env import Sb3VecEnv

    pose = "turtlebot_gym/TurtleBotPose-v0"
    envs = gym.make_vec(pose, num_envs=4, autoreset_mode=AutoresetMode.SAME_STEP, robot="waffle", noise="rough")
    export(small(normalized(Sb3VecEnv(envs))), tmp_path / "policy.onnx", steps=100)
    card = BundlePolicy(tmp_path / "policy.onnx").card
    assert (card.env, card.robot["name"], card.noise) == (pose, "waffle", "rough")
    assert card.training["normalized"]
    assert Path(tmp_path / "policy.onnx").is_file()
