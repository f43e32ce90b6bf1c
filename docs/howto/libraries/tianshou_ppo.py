import gymnasium as gym
import torch
import turtlebot_gym
from tianshou.algorithm import PPO
from tianshou.algorithm.modelfree.reinforce import ProbabilisticActorPolicy
from tianshou.algorithm.optim import AdamOptimizerFactory
from tianshou.data import Collector, VectorReplayBuffer
from tianshou.env import DummyVectorEnv
from tianshou.trainer import OnPolicyTrainerParams
from tianshou.utils.net.common import Net
from tianshou.utils.net.continuous import ContinuousActorProbabilistic, ContinuousCritic
from torch import nn
from torch.distributions import Independent, Normal
from turtlebot_gym_agents.training.export import export

ENV = "turtlebot_gym/TurtleBotNav-v0"
torch.manual_seed(0)
envs = DummyVectorEnv([lambda: gym.make(ENV)] * 64)
envs.seed(0)
network = {"state_shape": (13,), "hidden_sizes": (64, 64), "activation": nn.Tanh}
actor = ContinuousActorProbabilistic(preprocess_net=Net(**network), action_shape=(2,), unbounded=True)
algorithm = PPO(
    policy=ProbabilisticActorPolicy(
        actor=actor, dist_fn=lambda mean_std: Independent(Normal(*mean_std), 1), action_space=envs.action_space[0]
    ),
    critic=ContinuousCritic(preprocess_net=Net(**network)),
    optim=AdamOptimizerFactory(lr=1e-3),
    gamma=0.98,
    ent_coef=0.0,
)
params = OnPolicyTrainerParams(
    training_collector=Collector(algorithm, envs, VectorReplayBuffer(4096, 64)),
    max_epochs=20,
    epoch_num_steps=2048,
    collection_step_num_env_steps=2048,
    update_step_num_repetitions=10,
    batch_size=256,
    show_progress=False,
    verbose=False,
)
trainer = algorithm.create_trainer(params)
trainer.reset()
for _ in range(params.max_epochs):
    epoch = trainer.execute_epoch()
    print(f"{epoch.info_stat.train_step} steps, loss {epoch.training_stat.loss.mean:.4f}")
export(nn.Sequential(actor.preprocess.model, actor.mu), "nav.onnx", env=ENV)
