"""Plants, models that move the robot, as alternatives to `models.unicycle`."""

from turtlebot_gym.plants.burger import PLANTS, MujocoBurger, make_plant

__all__ = ["PLANTS", "MujocoBurger", "make_plant"]
