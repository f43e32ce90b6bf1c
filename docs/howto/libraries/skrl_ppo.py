import gymnasium as gym
import torch
import turtlebot_gym
from skrl.agents.torch.ppo import PPO, PPO_CFG
from skrl.envs.wrappers.torch import wrap_env
from skrl.memories.torch import RandomMemory
from skrl.models.torch import DeterministicMixin, GaussianMixin, Model
from skrl.trainers.torch import SequentialTrainer
from skrl.utils import set_seed
from torch import nn
from turtlebot_gym_agents.training.export import export

ENV = "turtlebot_gym/TurtleBotNav-v0"


def mlp(outputs):
    return nn.Sequential(nn.Linear(13, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, outputs))


class Policy(GaussianMixin, Model):
    def __init__(self, **spaces):
        Model.__init__(self, **spaces)
        GaussianMixin.__init__(self)
        self.net, self.log_std = mlp(2), nn.Parameter(torch.zeros(2))

    def compute(self, inputs, role):
        return self.net(inputs["observations"]), {"log_std": self.log_std}


class Value(DeterministicMixin, Model):
    def __init__(self, **spaces):
        Model.__init__(self, **spaces)
        DeterministicMixin.__init__(self)
        self.net = mlp(1)

    def compute(self, inputs, role):
        return self.net(inputs["observations"]), {}


set_seed(0)
env = wrap_env(gym.make_vec(ENV, num_envs=64))
spaces = {"observation_space": env.observation_space, "action_space": env.action_space, "device": "cpu"}
cfg = PPO_CFG(
    rollouts=32,
    learning_epochs=10,
    mini_batches=8,
    discount_factor=0.98,
    learning_rate=1e-3,
    value_clip=0.0,
    value_loss_scale=0.5,
    time_limit_bootstrap=True,
)
cfg.experiment.write_interval = cfg.experiment.checkpoint_interval = 0
agent = PPO(
    models={"policy": Policy(**spaces), "value": Value(**spaces)},
    memory=RandomMemory(memory_size=32, num_envs=64, device="cpu"),
    cfg=cfg,
    **spaces,
)
SequentialTrainer(env=env, agents=agent, cfg={"timesteps": 640, "headless": True, "disable_progressbar": True}).train()
for update, loss in enumerate(agent.tracking_data["Loss / Value loss"], 1):
    print(f"{update * 32 * 64} steps, loss {loss:.4f}")
export(agent.policy.net, "nav.onnx", env=ENV)
