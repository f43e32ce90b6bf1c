"""The blocks of the closed loop: plain objects that do not depend on ROS."""

from turtlebot_gym_ros.blocks.controller import VelocityController
from turtlebot_gym_ros.blocks.kalman_filter import KalmanFilter
from turtlebot_gym_ros.blocks.localizer import Localizer
from turtlebot_gym_ros.blocks.people_tracker import PeopleTracker
from turtlebot_gym_ros.blocks.simulator import TurtlebotSimulator
from turtlebot_gym_ros.blocks.waypoints import WaypointGenerator

__all__ = ["KalmanFilter", "Localizer", "PeopleTracker", "TurtlebotSimulator", "VelocityController", "WaypointGenerator"]
