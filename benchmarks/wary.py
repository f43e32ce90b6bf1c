"""A policy of layout 2 for tests and benchmarks: to the goal, but for directions in which something is near."""

import os

import numpy as np

WIDTH = 2.0 * np.pi / 36


def wary(observation):
    """Return the action for one observation, and append what it was given and answered to the file that WARY_LOG names."""
    observation = np.asarray(observation, np.float32)
    ranges = 3.5 * observation[13:49].astype(np.float64)
    reach = np.minimum.reduce([np.roll(ranges, shift) for shift in range(-3, 4)])
    goal = np.arctan2(observation[2], observation[1])
    angles = (np.arange(36) * WIDTH + np.pi) % (2.0 * np.pi) - np.pi
    away = np.abs((angles - goal + np.pi) % (2.0 * np.pi) - np.pi)
    clear = reach > min(0.45, float(observation[0]))
    heading = goal if clear[round(goal / WIDTH) % 36] else angles[np.argmin(away + 10.0 * ~clear)]
    forward = max(np.cos(heading), 0.0) ** 3 * min(max(ranges[[-2, -1, 0, 1, 2]].min() - 0.15, 0.0) / 0.4, 1.0)
    action = np.array([forward, np.clip(1.2 * heading, -1.0, 1.0)], np.float32)
    if path := os.environ.get("WARY_LOG"):
        with open(path, "ab") as log:
            log.write(observation.tobytes() + action.tobytes())
    return action


wary.layout = 2
