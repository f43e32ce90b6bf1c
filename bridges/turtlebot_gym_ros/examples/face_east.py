"""A custom block as a node: turn the robot until it faces east.

python face_east.py --ros-args -p gain:=2.0 -p start_enabled:=true
"""

from dataclasses import dataclass

from turtlebot_gym.values import STOP, Command, State
from turtlebot_gym_ros import Input, On, Output, run


@dataclass(frozen=True, kw_only=True)
class Params:
    """Parameters of the block, and of the node."""

    gain: float = 1.0
    """Turning rate per heading error, 1/s."""


class FaceEast:
    """Inputs: ``odometry`` (on ``odom``). Outputs: ``command`` (on ``cmd_vel``)."""

    inputs = {"odometry": Input(topic="odom", type=State, reliable=False)}
    outputs = {"command": Output(topic="cmd_vel", type=Command, stop=STOP)}
    trigger = On("odometry")

    def __init__(self, params: Params) -> None:
        self.gain = params.gain

    def reset(self) -> None:
        """Do nothing: the block has no state."""

    def step(self, dt: float, odometry: State) -> dict[str, Command]:
        """Turn against the heading error."""
        return {"command": Command(0.0, -self.gain * odometry.theta)}


if __name__ == "__main__":
    raise SystemExit(run(FaceEast, Params))
