"""``python -m turtlebot_gym`` is the command ``turtlebot-gym``."""

from runpy import run_module

run_module("turtlebot_gym_agents", run_name="__main__")
