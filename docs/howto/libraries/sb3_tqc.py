import gymnasium as gym
import turtlebot_gym
from gymnasium.vector import AutoresetMode
from sb3_contrib import TQC
from turtlebot_gym_agents.training.export import export
from turtlebot_gym_agents.training.sb3_vec_env import Sb3VecEnv

ENV = "turtlebot_gym/TurtleBotNav-v0"
envs = gym.make_vec(ENV, num_envs=16, autoreset_mode=AutoresetMode.SAME_STEP)
network = {"net_arch": [64, 64], "n_critics": 1}
model = TQC("MlpPolicy", Sb3VecEnv(envs), learning_starts=2000, gradient_steps=2, learning_rate=1e-3, gamma=0.98,
            policy_kwargs=network, device="cpu", seed=0)  # fmt: skip
model.learn(20_000)
print(f"{model.num_timesteps} steps, loss {model.logger.name_to_value['train/critic_loss']:.4f}")
export(model, "nav.onnx", env=ENV)
