import ray
from ray.rllib.algorithms.ppo import PPOConfig

ray.init(address="local", num_cpus=2, include_dashboard=False)
config = (
    PPOConfig()
    .environment("turtlebot_gym:turtlebot_gym/TurtleBotNav-v0", env_config={"noise": "documented"})
    .env_runners(num_env_runners=1, num_envs_per_env_runner=16)
    .training(train_batch_size=4096, minibatch_size=512, num_epochs=4, lr=1e-3, gamma=0.98)
)
algorithm = config.build_algo()
for _ in range(5):
    result = algorithm.train()
    learner = result["learners"]["default_policy"]
    print(f"{result['num_env_steps_sampled_lifetime']:.0f} steps, loss {learner['total_loss']:.4f}")
