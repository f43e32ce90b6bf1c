"""The guard's parameters of a Burger, by its name, without scans."""

from functools import partial

from cmd_vel_guard import parameters

Parameters = partial(parameters.Parameters, robot="burger", collision_monitor=False)
