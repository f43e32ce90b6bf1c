import gymnasium as gym
import numpy as np
import torch
import turtlebot_gym
from gymnasium.vector import AutoresetMode
from torch import nn
from torch.distributions import Normal
from turtlebot_gym_agents.training.export import export

ENV = "turtlebot_gym/TurtleBotNav-v0"
NUM_ENVS, NUM_STEPS, UPDATES, EPOCHS, MINIBATCH = 64, 32, 20, 10, 256
GAMMA, LAMBDA, CLIP, RATE = 0.98, 0.95, 0.2, 1e-3


def mlp(outputs):
    return nn.Sequential(nn.Linear(13, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, outputs))


torch.set_num_threads(1)  # networks this small take four times the CPU time on several
torch.manual_seed(0)
envs = gym.make_vec(ENV, num_envs=NUM_ENVS, autoreset_mode=AutoresetMode.SAME_STEP)
actor, critic, log_std = mlp(2), mlp(1), nn.Parameter(torch.zeros(2))
parameters = [*actor.parameters(), *critic.parameters(), log_std]
optimizer = torch.optim.Adam(parameters, lr=RATE, eps=1e-5)
seen = torch.from_numpy(envs.reset(seed=0)[0])
for update in range(1, UPDATES + 1):
    observations, actions = torch.zeros(NUM_STEPS, NUM_ENVS, 13), torch.zeros(NUM_STEPS, NUM_ENVS, 2)
    log_probs, values, rewards, ended = torch.zeros(4, NUM_STEPS, NUM_ENVS)
    with torch.no_grad():
        for t in range(NUM_STEPS):
            drawn = Normal(actor(seen), log_std.exp())
            observations[t], actions[t] = seen, drawn.sample()
            log_probs[t], values[t] = drawn.log_prob(actions[t]).sum(-1), critic(seen).squeeze(-1)
            following, reward, terminated, truncated, infos = envs.step(actions[t].numpy())
            rewards[t], ended[t] = torch.from_numpy(reward), torch.from_numpy(terminated | truncated)
            timed_out = truncated & ~terminated
            if timed_out.any():
                last = torch.from_numpy(np.stack(infos["final_obs"][timed_out]))
                rewards[t, torch.from_numpy(timed_out)] += GAMMA * critic(last).squeeze(-1)
            seen = torch.from_numpy(following)
        advantages, advantage, next_value = torch.zeros(NUM_STEPS, NUM_ENVS), 0.0, critic(seen).squeeze(-1)
        for t in reversed(range(NUM_STEPS)):
            goes_on = 1.0 - ended[t]
            delta = rewards[t] + GAMMA * goes_on * next_value - values[t]
            advantages[t] = advantage = delta + GAMMA * LAMBDA * goes_on * advantage
            next_value = values[t]
    rows = [each.flatten(0, 1) for each in (observations, actions, log_probs, advantages, advantages + values)]
    for _ in range(EPOCHS):
        for chosen in torch.randperm(NUM_STEPS * NUM_ENVS).split(MINIBATCH):
            observation, action, log_prob, advantage, target = (each[chosen] for each in rows)
            drawn = Normal(actor(observation), log_std.exp())
            ratio = (drawn.log_prob(action).sum(-1) - log_prob).exp()
            advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
            gain = torch.min(ratio * advantage, ratio.clamp(1.0 - CLIP, 1.0 + CLIP) * advantage)
            loss = 0.5 * (critic(observation).squeeze(-1) - target).square().mean() - gain.mean()
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(parameters, 0.5)
            optimizer.step()
    print(f"{update * NUM_STEPS * NUM_ENVS} steps, loss {loss.item():.4f}")
export(actor, "nav.onnx", env=ENV)
