"""A robot's installation: numpy and PyYAML, nothing that trains, draws or compiles, and the same numbers to the bit.

As a program, this module prints them where the packages that are its arguments are not found, as if they were not installed.
"""

import subprocess
import sys
from pathlib import Path

TRAINS = ("llvmlite", "scipy", "gymnasium", "filterpy", "torch", "stable_baselines3", "onnx")
ABSENT = (*TRAINS, "matplotlib", "pygame", "PIL", "tyro", "rich")
ROS = ("rclpy", "geometry_msgs", "nav_msgs", "sensor_msgs", "diagnostic_msgs", "std_msgs", "std_srvs")
ROOT = Path(__file__).parents[2]
NUMBERS = {"max_linear": 0.2108, "max_angular": 2.635, "max_wheel": 0.2097, "wheel_separation": 0.16, "radius": 0.105}
"""Of a Burger, for the guard."""


def drive(steps=40):
    """Close the loop without ROS, with the guard behind the controller; return one tuple of numbers for each step."""
    from cmd_vel_guard.arbiter import Arbiter
    from cmd_vel_guard.collision import RawScan
    from cmd_vel_guard.parameters import Parameters
    from turtlebot_gym.values import Pose
    from turtlebot_gym_ros.blocks import KalmanFilter, TurtlebotSimulator, VelocityController, WaypointGenerator

    rows = []
    for noise, filter in (("tutorial", "matched"), ("rough", "gated"), ("wheel", "matched")):
        plant = TurtlebotSimulator(TurtlebotSimulator.Params(noise=noise, seed=11))
        estimator = KalmanFilter(KalmanFilter.Params(noise=noise, filter=filter))
        generator = WaypointGenerator(WaypointGenerator.Params())
        controller = VelocityController(VelocityController.Params(goal_tolerance=0.0))
        guard, command = Arbiter(Parameters(**NUMBERS), 0.0), None
        scan = RawScan([0.8] * 360, 0.0, 0.017453292519943295, 0.12, 3.5, "base_scan")
        for k in range(steps):
            now = 0.1 * k
            values = estimator.step(0.1 * (k > 0), plant.step(0.1, command)["odometry"])
            reference = generator.step(0.1, values["estimate"], None)["reference"]
            wanted = controller.step(0.1, values["estimate"], reference, Pose(1.0, 1.0, 0.0), nis=values["nis"])["command"]
            guard.hear_scan(scan, now, sent=now, dated=True)
            guard.hear("program", wanted, now, sent=now, dated=True)
            command = guard.step(now) or command
            rows.append((*values["estimate"].belief.mean, *values["estimate"].belief.covariance, values["nis"].value, *command))
    return rows


def installed():
    """Return the packages that were loaded and are no part of Python, of ROS or of this project."""
    files = {name: str(getattr(module, "__file__", "")) for name, module in sys.modules.items()}
    names = {name.split(".")[0] for name, file in files.items() if "site-packages" in file}
    ours = ("turtlebot_gym", "_", "rcl", "rosidl", "rpyutils", "ament_index", "ros_wheels")
    return {name for name in names if not name.startswith(ours)}


def test_filter_policy_and_guard_give_the_same_bits_without_what_trains_and_draws():
    done = subprocess.run([sys.executable, __file__, *ABSENT, *ROS], capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    *lines, loaded = done.stdout.splitlines()
    assert [tuple(map(float.fromhex, line.split())) for line in lines] == drive()
    assert set(loaded.split()) <= {"numpy", "yaml"}


if __name__ == "__main__":
    sys.modules |= dict.fromkeys(sys.argv[1:])  # an import of these fails
    for row in drive():
        print(*(number.hex() for number in row))
    print(*sorted(installed()))
