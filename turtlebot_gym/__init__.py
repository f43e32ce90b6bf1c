"""A TurtleBot that navigates on what a Kalman filter believes: Gymnasium environments, filter and odometry models.

Importing this package registers the environments' ids where gymnasium is installed, as by the extra ``gym``. Without it and a
compiler, as on a robot, the filter, the models and the tasks still work.
"""

from importlib.util import find_spec

from turtlebot_gym.config import read_parameters
from turtlebot_gym.estimation.ekf import Estimate
from turtlebot_gym.files import write_parameters
from turtlebot_gym.heart import Episode
from turtlebot_gym.observations import Observation, ObservationTerm
from turtlebot_gym.parameters import FilterTuning, FixNoise, Noise, OdometryNoise, ProcessNoise
from turtlebot_gym.presets import NOISES, make_filter, make_noise, make_robot
from turtlebot_gym.rewards import RewardTerm
from turtlebot_gym.robots import ROBOTS, Robot
from turtlebot_gym.systems import Options, Parameters, Snapshot, System, make_parameters
from turtlebot_gym.tasks import NAV, POSE, SQUARE, SQUARE_WAYPOINTS, TASKS, Task
from turtlebot_gym.values import STOP, Belief, Command, Covariance, Pose, State

__version__ = "0.2.0"

__all__ = [
    "NAV",
    "NOISES",
    "POSE",
    "ROBOTS",
    "SQUARE",
    "SQUARE_WAYPOINTS",
    "STOP",
    "Belief",
    "Command",
    "Covariance",
    "Episode",
    "Estimate",
    "FilterTuning",
    "FixNoise",
    "Noise",
    "Observation",
    "ObservationTerm",
    "OdometryNoise",
    "Options",
    "Parameters",
    "Pose",
    "ProcessNoise",
    "RewardTerm",
    "Robot",
    "Snapshot",
    "State",
    "System",
    "Task",
    "make_filter",
    "make_noise",
    "make_parameters",
    "make_robot",
    "read_parameters",
    "write_parameters",
]


def _register_environments() -> None:
    from gymnasium.envs.registration import register

    ids = {"Nav": "nav", "Pose": "pose", "Square": "square", "Rooms": "room", "Missions": "mission"}
    for name, task in ids.items():
        register(
            id=f"turtlebot_gym/TurtleBot{name}-v0",
            entry_point="turtlebot_gym.envs.navigation:NavigationEnv",
            vector_entry_point="turtlebot_gym.envs.vector:make_vector",
            max_episode_steps=int(TASKS[task].max_steps),
            kwargs={"task": task},
        )


if find_spec("gymnasium") is not None:
    _register_environments()
