"""A TurtleBot3 Burger's numbers, as anybody would state them."""

from functools import partial

from cmd_vel_guard import parameters

NUMBERS = {
    "max_linear": 0.2108,
    "max_angular": 2.635,
    "max_wheel": 0.2097,
    "wheel_separation": 0.16,
    "radius": 0.105,
    "footprint_x": -0.024,
    "scan_x": -0.032,
}
Parameters = partial(parameters.Parameters, **NUMBERS, collision_monitor=False)
"""The guard's parameters of a Burger without scans."""
WORDS = [word for name, value in [*NUMBERS.items(), ("collision_monitor", "false")] for word in ("-p", f"{name}:={value}")]
"""The same as words of a ROS command line."""
