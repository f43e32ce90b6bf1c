"""Plants besides the unicycle: what moves the robot, in place of `models.unicycle`."""

from turtlebot_gym.plants.burger import PLANTS, MujocoBurger, make_plant

__all__ = ["PLANTS", "MujocoBurger", "make_plant"]
