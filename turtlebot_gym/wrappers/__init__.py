"""Wrappers in Gymnasium's form that Gymnasium does not have; those for vector environments are in `wrappers.vector`.

To stack the observations of a scalar environment, use Gymnasium's `FrameStackObservation`.
"""

from turtlebot_gym.wrappers.common import Moment, Transition
from turtlebot_gym.wrappers.doubts import ModelDoubts
from turtlebot_gym.wrappers.scalar import SmoothAction, TransitionReward

__all__ = ["ModelDoubts", "Moment", "SmoothAction", "Transition", "TransitionReward"]
