"""Drives of the environment that excite all parameters of the noise, as if they had been recorded."""

import gymnasium as gym
import numpy as np

from turtlebot_gym import Noise
from turtlebot_gym.drive import Drive

HOLD = 15
"""Steps for which a command is held."""


def simulated_log(noise: Noise, *, seed: int, steps: int = 3000, dt: float = 0.1) -> Drive:
    """Return a drive of the environment that excites all parameters: straight ahead, on the spot and in arcs, in random order.

    Noise and commands are drawn from the seed; dt: Control interval, s.
    """
    random = np.random.default_rng(seed)
    options = {"noise": noise, "dt": dt, "switch": "time", "max_episode_steps": steps + 1}
    env = gym.make("turtlebot_gym/TurtleBotSquare-v0", **options).unwrapped
    infos = [env.reset(seed=seed)[1]]
    action = np.zeros(2, np.float32)
    for step in range(steps):
        if step % HOLD == 0:
            straight = (random.uniform(0.6, 1.0), 0.0)
            turning = (0.0, random.uniform(0.1, 0.35) * random.choice((-1.0, 1.0)))
            arc = (random.uniform(0.3, 0.8), random.uniform(-0.2, 0.2))
            action = np.array((straight, turning, arc)[random.integers(3)], np.float32)
        infos.append(env.step(action)[4])
    env.close()
    columns = {name: np.array([info[name] for info in infos], np.float64) for name in ("command", "odometry", "true_state")}
    twist = np.concatenate([np.zeros((1, 2)), columns["command"][:-1]])  # a command moves the robot in the interval after it
    poses = columns["odometry"]
    if not noise.odometry.wheel:
        poses[1:][(poses[1:] == poses[:-1]).all(axis=1)] = np.nan  # a lost measurement repeats the last one
    return Drive(time=dt * np.arange(steps + 1), twist=twist, odometry=poses, true_state=columns["true_state"])
