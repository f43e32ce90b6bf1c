import gymnasium as gym
import turtlebot_gym
from gymnasium.vector import AutoresetMode
from sb3_contrib import RecurrentPPO
from turtlebot_gym_agents.training.export import export
from turtlebot_gym_agents.training.sb3_vec_env import Sb3VecEnv

ENV = "turtlebot_gym/TurtleBotNav-v0"
envs = gym.make_vec(ENV, num_envs=64, autoreset_mode=AutoresetMode.SAME_STEP)
model = RecurrentPPO(
    "MlpLstmPolicy", Sb3VecEnv(envs), n_steps=32, batch_size=512, n_epochs=4, learning_rate=2e-3, gamma=0.98,
    policy_kwargs={"lstm_hidden_size": 32}, device="cpu", seed=0,
)  # fmt: skip
model.learn(20_480)
print(f"{model.num_timesteps} steps, loss {model.logger.name_to_value['train/loss']:.4f}")
export(model, "nav.onnx", env=ENV)
