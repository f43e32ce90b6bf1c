"""What a person imports: the commands as Python functions, whose results are objects.

The names are those of `turtlebot_gym_agents`, for example ``from turtlebot_gym_agents import compare, train``.
"""
