"""The limit of a training: PPO in NumPy alone, without torch, on the native vector environment.

It trains on Nav: ``python benchmarks/limit.py SEED ROLLOUTS`` prints one line of JSON with steps, success on unseen episodes,
and CPU seconds of imports, compiled loops, rollouts and updates. `training.py` runs it on one thread.

References:
    Schulman, Wolski, Dhariwal, Radford, Klimov, "Proximal policy optimization algorithms" (2017), arXiv:1707.06347.
    Schulman, Moritz, Levine, Jordan, Abbeel, "High-dimensional continuous control using generalized advantage
    estimation" (2016), arXiv:1506.02438.
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray

import turtlebot_gym  # noqa: F401  # registers the environments

Floats = NDArray[np.float32]
Network = list[Floats]
"""Weights and biases of three layers, in turn."""
UNITS, ENVS, STEPS, EPOCHS, BATCH = 32, 64, 32, 10, 256
"""Units of a layer; environments; steps of each in a rollout; passes over a rollout; rows of an update."""
GAMMA, LAMBDA, CLIP, NORM = 0.98, 0.95, 0.2, 0.5
"""Discount; GAE's factor; clipping of the ratio; largest norm of a gradient."""
RATE, LAST = 1e-3, 0.1
"""Learning rate at first, and the share of it that is left at the end."""
DEVIATION = -0.5
"""Logarithm of the actions' standard deviation at first."""
NAV = "turtlebot_gym/TurtleBotNav-v0"
EPISODES, UNSEEN = 2000, 777_000_000
"""Episodes of the evaluation, and the seed of the first."""


class Rollout(NamedTuple):
    """Rows of a rollout, in any order."""

    observations: Floats
    actions: Floats
    log_likelihoods: Floats
    advantages: Floats
    returns: Floats


def make_network(random: np.random.Generator, inputs: int, outputs: int, gain: float) -> Network:
    """Return a network with orthogonal weights, of which the last layer's have a gain."""
    network = []
    for rows, columns, scale in ((inputs, UNITS, 2**0.5), (UNITS, UNITS, 2**0.5), (UNITS, outputs, gain)):
        orthogonal, _ = np.linalg.qr(random.normal(size=(max(rows, columns), min(rows, columns))))
        weights = orthogonal if rows >= columns else orthogonal.T
        network += [(scale * weights).astype(np.float32), np.zeros(columns, np.float32)]
    return network


def forward(network: Network, rows: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the activations of both hidden layers, and the outputs."""
    first = np.tanh(rows @ network[0] + network[1])
    second = np.tanh(first @ network[2] + network[3])
    return first, second, second @ network[4] + network[5]


def backward(network: Network, rows: Floats, first: Floats, second: Floats, slopes: Floats) -> Network:
    """Return the gradient of a loss whose derivatives with respect to the outputs are ``slopes``."""
    beyond = (slopes @ network[4].T) * (1 - second * second)
    before = (beyond @ network[2].T) * (1 - first * first)
    layers = ((rows, before), (first, beyond), (second, slopes))
    return [part for seen, slope in layers for part in (seen.T @ slope, slope.sum(0))]


class Learner:
    """Actor, critic and their optimizer, Adam.

    Args:
        seed: Seed of the weights, the actions and the order of the rows.
        size: Numbers of an observation.
    """

    def __init__(self, seed: int, size: int) -> None:
        self.random = np.random.default_rng(seed)
        self.actor = make_network(self.random, size, 2, 0.01)
        self.critic = make_network(self.random, size, 1, 1.0)
        self.log_std = np.full(2, DEVIATION, np.float32)
        self._parameters = [*self.actor, *self.critic, self.log_std]
        self._moments = [(np.zeros_like(part), np.zeros_like(part)) for part in self._parameters]
        self._updates = 0

    def act(self, observations: Any) -> Floats:
        """Return the mean actions, clipped to [-1, 1]."""
        return np.clip(forward(self.actor, observations)[2], -1.0, 1.0)

    def value(self, observations: Floats) -> Floats:
        return forward(self.critic, observations)[2][:, 0]

    def collect(self, envs: VectorEnv, observations: Floats) -> tuple[Rollout, Floats]:
        """Drive for a rollout, and return it with the observations after it."""
        seen, actions = np.zeros((STEPS, ENVS, observations.shape[1]), np.float32), np.zeros((STEPS, ENVS, 2), np.float32)
        likelihoods, values, rewards, over = (np.zeros((STEPS, ENVS), np.float32) for _ in range(4))
        for step in range(STEPS):
            noise = self.random.standard_normal((ENVS, 2), np.float32)
            seen[step], values[step] = observations, self.value(observations)
            actions[step] = forward(self.actor, observations)[2] + np.exp(self.log_std) * noise
            likelihoods[step] = (-0.5 * noise * noise - self.log_std).sum(1)
            observations, rewards[step], terminated, truncated, infos = envs.step(np.clip(actions[step], -1.0, 1.0))
            over[step] = terminated | truncated
            if (late := truncated & ~terminated).any():
                rewards[step, late] += GAMMA * self.value(np.stack(infos["final_obs"][late]))
        advantages, later, next_values = np.zeros_like(values), np.zeros(ENVS, np.float32), self.value(observations)
        for step in reversed(range(STEPS)):
            goes_on = 1.0 - over[step]
            later = rewards[step] + GAMMA * goes_on * next_values - values[step] + GAMMA * LAMBDA * goes_on * later
            advantages[step], next_values = later, values[step]
        columns = (seen, actions, likelihoods, advantages, advantages + values)
        return Rollout(*(column.reshape(ENVS * STEPS, *column.shape[2:]) for column in columns)), observations

    def learn(self, rollout: Rollout, rate: float) -> None:
        """Update actor and critic on a rollout."""
        for _ in range(EPOCHS):
            for chosen in self.random.permutation(len(rollout.returns)).reshape(-1, BATCH):
                self._update(Rollout(*(column[chosen] for column in rollout)), rate)

    def _update(self, rows: Rollout, rate: float) -> None:
        first, second, means = forward(self.actor, rows.observations)
        std = np.exp(self.log_std)
        noise = (rows.actions - means) / std
        ratios = np.exp((-0.5 * noise * noise - self.log_std).sum(1) - rows.log_likelihoods)
        weights = (rows.advantages - rows.advantages.mean()) / (rows.advantages.std() + 1e-8)
        clipped = ((ratios > 1 + CLIP) & (weights > 0)) | ((ratios < 1 - CLIP) & (weights < 0))
        slopes = (-ratios * weights * ~clipped / len(ratios))[:, None].astype(np.float32)  # of the logarithm of the likelihood
        gradient = backward(self.actor, rows.observations, first, second, (slopes * noise / std).astype(np.float32))
        first, second, values = forward(self.critic, rows.observations)
        errors = ((values - rows.returns[:, None]) / len(ratios)).astype(np.float32)
        gradient += backward(self.critic, rows.observations, first, second, errors)
        gradient += [(slopes * (noise * noise - 1)).sum(0)]
        self._descend(gradient, rate)

    def _descend(self, gradient: Network, rate: float) -> None:
        """Make a step of Adam, with the gradient's norm clipped."""
        self._updates += 1
        scale = np.float32(min(1.0, NORM / (sum(float((part * part).sum()) for part in gradient) ** 0.5 + 1e-6)))
        step, spread = rate / (1 - 0.9**self._updates), 1 / (1 - 0.999**self._updates)
        for parameter, part, (mean, square) in zip(self._parameters, gradient, self._moments, strict=True):
            part *= scale
            mean += np.float32(0.1) * (part - mean)
            square += np.float32(0.001) * (part * part - square)
            parameter -= np.float32(step) * mean / (np.sqrt(square * np.float32(spread)) + np.float32(1e-5))


def evaluate(env: str, learner: Learner) -> float:
    """Return the share of unseen episodes that reach their goal."""
    envs = gym.make_vec(env, num_envs=EPISODES, autoreset_mode=AutoresetMode.SAME_STEP)
    observations, _ = envs.reset(seed=UNSEEN)
    running, success = np.ones(EPISODES, np.bool_), np.zeros(EPISODES, np.bool_)
    while running.any():
        observations, _, terminated, truncated, infos = envs.step(learner.act(observations))
        if (done := running & (terminated | truncated)).any():
            success[done] = infos["final_info"]["is_success"][done]
            running &= ~done
    return float(success.mean())


def main(seed: int, rollouts: int) -> dict[str, Any]:
    """Train, and return steps, success and CPU seconds by phase."""
    mark = time.process_time()
    spent = {"imports": mark, "compile": 0.0, "rollouts": 0.0, "updates": 0.0}

    def charge(phase: str) -> None:
        nonlocal mark
        spent[phase] += (now := time.process_time()) - mark
        mark = now

    envs = gym.make_vec(NAV, num_envs=ENVS, autoreset_mode=AutoresetMode.SAME_STEP)
    envs.reset(seed=seed)
    envs.step(np.zeros((ENVS, 2), np.float32))
    observations, _ = envs.reset(seed=seed)
    charge("compile")
    learner = Learner(seed, observations.shape[1])
    for number in range(rollouts):
        rollout, observations = learner.collect(envs, observations)
        charge("rollouts")
        learner.learn(rollout, RATE * (1 - (1 - LAST) * number / rollouts))
        charge("updates")
    return {"steps": rollouts * ENVS * STEPS, "cpu": spent, "success": evaluate(NAV, learner)}


if __name__ == "__main__":
    print(json.dumps(main(*map(int, sys.argv[1:]))))
