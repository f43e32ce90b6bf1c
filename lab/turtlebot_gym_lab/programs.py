"""Programs of ``python -m turtlebot_gym_ros``: plain data, without the imports of their code."""

from turtlebot_gym_ros.nodes import Entry

FIELD_TEST = Entry(
    "field.program:main", "guides a person through the first afternoon with a robot", package="turtlebot_gym_lab"
)
