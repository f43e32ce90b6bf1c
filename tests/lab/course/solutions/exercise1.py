"""A solution of exercise 1."""

import numpy as np

EXERCISE = 1


def wrapped(angle: float) -> float:
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def innovation(z: np.ndarray, x: np.ndarray) -> np.ndarray:
    return np.array([z[0] - x[0], z[1] - x[1], wrapped(z[2] - x[2])])


def update(x: np.ndarray, P: np.ndarray, z: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    K = P @ np.linalg.inv(P + R)
    mean = x + K @ innovation(z, x)
    mean[2] = wrapped(mean[2])
    return mean, (np.eye(3) - K) @ P
