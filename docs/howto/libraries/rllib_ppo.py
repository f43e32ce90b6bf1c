import ray
import turtlebot_gym
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
from torch import nn
from turtlebot_gym_agents.training.export import export

ENV = "turtlebot_gym/TurtleBotNav-v0"
ray.init(address="local", num_cpus=1, include_dashboard=False)
config = (
    PPOConfig()
    .environment(ENV)
    .env_runners(
        num_env_runners=0, num_envs_per_env_runner=64, rollout_fragment_length=32, gym_env_vectorize_mode="vector_entry_point"
    )
    .training(train_batch_size=2048, minibatch_size=256, num_epochs=10, lr=1e-3, gamma=0.98, lambda_=0.95, kl_coeff=0.0)
    .rl_module(model_config=DefaultModelConfig(fcnet_hiddens=[64, 64], free_log_std=True, vf_share_layers=False))
    .debugging(seed=0)
)
algorithm = config.build_algo()
for _ in range(20):
    result = algorithm.train()
    learner = result["learners"]["default_policy"]
    print(f"{result['num_env_steps_sampled_lifetime']:.0f} steps, loss {learner['total_loss']:.4f}")
module = algorithm.get_module()
mean = nn.Sequential(module.encoder.actor_encoder.net, module.pi.net)  # with free_log_std the head's net gives the means alone
export(mean, "nav.onnx", env=ENV, training={"library": f"ray {ray.__version__}", "algorithm": "PPO", "seed": 0})
