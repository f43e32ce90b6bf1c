"""The guard's parameters of a Burger, by the presets of this project, without scans."""

from functools import partial

from cmd_vel_guard import parameters
from cmd_vel_guard.robots import SOURCES
from turtlebot_gym_ros.guarded import numbers_of

SOURCES.append(numbers_of)  # where the entry point is not installed
Parameters = partial(parameters.Parameters, robot="burger", collision_monitor=False)
