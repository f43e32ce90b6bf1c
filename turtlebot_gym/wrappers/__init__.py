"""Wrappers in Gymnasium's form, for what none of its own does; those for vector environments are in `wrappers.vector`.

A history of a scalar environment's observations is Gymnasium's `FrameStackObservation`.
"""

from turtlebot_gym.wrappers.scalar import AppendSensor, SmoothAction, TransitionReward
from turtlebot_gym.wrappers.transition import Moment, Transition

__all__ = ["AppendSensor", "Moment", "SmoothAction", "Transition", "TransitionReward"]
