import gymnasium as gym
import torch
import turtlebot_gym
from gymnasium.vector import AutoresetMode
from tensordict.nn import AddStateIndependentNormalScale, TensorDictModule
from torch import nn
from torchrl.collectors import Collector
from torchrl.envs import GymWrapper
from torchrl.modules import IndependentNormal, ProbabilisticActor, ValueOperator
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE
from turtlebot_gym_agents.training.export import export

ENV = "turtlebot_gym/TurtleBotNav-v0"


def mlp(outputs):
    return nn.Sequential(nn.Linear(13, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, outputs))


torch.manual_seed(0)
env = GymWrapper(gym.make_vec(ENV, num_envs=64, autoreset_mode=AutoresetMode.DISABLED))
mean = mlp(2)
scaled = TensorDictModule(nn.Sequential(mean, AddStateIndependentNormalScale(2)), ["observation"], ["loc", "scale"])
actor = ProbabilisticActor(
    scaled, in_keys=["loc", "scale"], distribution_class=IndependentNormal, distribution_kwargs={"tanh_loc": False},
    return_log_prob=True,
)  # fmt: skip
critic = ValueOperator(mlp(1), in_keys=["observation"])
advantage = GAE(gamma=0.98, lmbda=0.95, value_network=critic)
objective = ClipPPOLoss(actor, critic, entropy_coeff=0.0, critic_coeff=0.5, normalize_advantage=True)
optimizer = torch.optim.Adam(objective.parameters(), lr=1e-3)
steps = 0
for batch in Collector(env, actor, frames_per_batch=2048, total_frames=40_960):
    with torch.no_grad():
        advantage(batch)
    rows = batch.reshape(-1)
    for _ in range(10):
        for chosen in torch.randperm(len(rows)).split(256):
            losses = objective(rows[chosen])
            loss = losses["loss_objective"] + losses["loss_critic"]
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(objective.parameters(), 0.5)
            optimizer.step()
    steps += len(rows)
    print(f"{steps} steps, loss {loss.item():.4f}")
export(mean, "nav.onnx", env=ENV)
