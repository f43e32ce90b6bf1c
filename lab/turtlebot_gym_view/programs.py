"""Programs of ``python -m turtlebot_gym_ros``: plain data, without the imports of their code."""

from turtlebot_gym_ros.nodes import Entry

WATCH = Entry("graph:main", "shows the running graph in a browser", package="turtlebot_gym_view")
