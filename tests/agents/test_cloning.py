"""A training may begin with a known policy: its network acts like it, and the first updates do not change the actions."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from turtlebot_gym_agents.evaluation.driving import judge
from turtlebot_gym_agents.policies import make_policy
from turtlebot_gym_agents.training import cloning
from turtlebot_gym_agents.training.callbacks import EVALUATION_SEED, policy_of
from turtlebot_gym_agents.training.config import TrainingConfig
from turtlebot_gym_agents.training.model import make_model
from turtlebot_gym_agents.training.train import learn

HYPER = {"n_envs": 128, "n_timesteps": 2048, "policy": "MlpPolicy", "n_steps": 16, "batch_size": 1024, "n_epochs": 1}
HYPER |= {"policy_kwargs": {"net_arch": [64, 64], "activation_fn": "ReLU", "log_std_init": -0.5}}
small = TrainingConfig(config=HYPER, from_policy="bearing", episodes=8, evaluations=2)


def made(config=small):
    envs = config.make_training()
    return make_model(config, envs), envs


def test_the_network_drives_like_its_teacher_in_the_states_that_it_reaches():
    (model, envs), teacher, judges = made(), make_policy("bearing"), small.make(200)
    cloning.begin_with(model, envs, small)
    act = policy_of(model)
    reached, of_teacher = (judge(judges, policy, seed=EVALUATION_SEED, episodes=200).figures() for policy in (act, teacher))
    assert reached["success"] >= of_teacher["success"] - 0.05
    assert reached["return"] >= 0.95 * of_teacher["return"]
    observations, _ = judges.reset(seed=5)
    for _ in range(30):
        observations, *_ = judges.step(act(observations))
    assert np.abs(act(observations) - np.clip(teacher(observations), -1.0, 1.0)).mean() < 0.1


@pytest.mark.parametrize(("share", "learns"), [(1.0, False), (0.0, True)])
def test_actions_learn_after_the_critic(monkeypatch, share, learns):
    monkeypatch.setattr(cloning, "WARM_UP", share)
    monkeypatch.setattr(cloning, "clone", lambda *arguments, **others: None)
    before, (model, envs) = made()[0].policy.state_dict(), made()
    learn(model, small, envs, [])
    after = model.policy.state_dict()
    changed = {name for name, value in after.items() if not torch.equal(value, before[name])}
    actor = {name for name in after if "policy_net" in name or "action_net" in name or name == "log_std"}
    assert {name for name in after if "value" in name} <= changed
    assert actor & changed == (actor if learns else set())


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"from_policy": "vfh"}, "steers by a LiDAR"),
        ({"from_policy": "no"}, "policy must"),
        ({"algo": "sac"}, "from_policy needs"),
    ],
)
def test_what_cannot_be_cloned_is_refused(changed, message):
    def learned():
        config, envs = replace(small, config=None, **changed), small.make(512)
        learn(make_model(config, envs), config, envs, [])

    with pytest.raises(ValueError, match=message):
        learned()
