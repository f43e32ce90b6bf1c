"""Noise of all kinds, and actions that meet all that an episode has, for comparisons to the last bit."""

import numpy as np

from turtlebot_gym import Noise, OdometryNoise, ProcessNoise

SHAKY = Noise(
    process=ProcessNoise(alpha1=0.02, alpha2=0.001, alpha3=0.05, alpha4=0.01, slip=0.5, slip_start=0.05, slip_end=0.2),
    odometry=OdometryNoise(
        R=(0.01, 0.02, 0.03),
        bias=(0.02, -0.01, 0.03),
        spike_probability=0.1,
        spike=0.5,
        dropout_probability=0.1,
    ),
)
"""Every kind of error at once."""


def drive(observations, rng):
    """Return noisy actions that often arrive, sometimes leave the action space, and differ from row to row."""
    distance, cosine, sine, cos_turn, sin_turn = observations.T[:5].astype(float)
    bearing, turn = np.arctan2(sine, cosine), np.arctan2(sin_turn, cos_turn)
    close = distance < 0.12
    actions = np.column_stack([np.where(close, 0.0, cosine), np.where(close, 0.5 * turn, 1.5 * bearing)])
    return actions + np.where(close, 0.05, 0.5)[:, None] * rng.normal(size=actions.shape)
