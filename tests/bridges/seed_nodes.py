"""The nodes of pykal's TurtleBot notebook, in our words: the same calls of ``ROSNode`` with the same names, types and numbers.

After ``docs/source/notebooks/tutorial/python_to_ros/turtlebot_ros_deployment.ipynb`` of
https://github.com/nehalsinghmangat/pykal. Of its imports that of ``ROSNode`` is changed; its ``KF`` stays pykal's own.
"""

import numpy as np
from geometry_msgs.msg import PoseStamped, Twist
from nav_msgs.msg import Odometry

from turtlebot_gym_ros import ROSNode

SQUARE = [(2.0, 0.0, 0.0), (2.0, 2.0, np.pi / 2), (0.0, 2.0, np.pi), (0.0, 0.0, -np.pi / 2)]
R = np.diag([0.05, 0.05, 0.1])
MANEUVERS = [
    (5, 0.15, 0.0),
    (8, 0.15, 0.8),
    (13, 0.15, 0.0),
    (16, 0.15, -0.8),
    (21, 0.15, 0.0),
    (24, 0.0, 1.5),
    (30, 0.15, 0.0),
]


def heading(qz, qw):
    return np.arctan2(2.0 * qw * qz, 1.0 - 2.0 * qz**2)


def odometry(x, y, theta, true_theta, v, omega):
    turned = [0.0, 0.0, np.sin(theta / 2.0), np.cos(theta / 2.0)]
    return np.array([x, y, 0.0, *turned, v * np.cos(true_theta), v * np.sin(true_theta), 0.0, 0.0, 0.0, omega])


def waypoint_node(waypoints=SQUARE, switch_time=15.0, rate_hz=10.0):
    def waypoint_callback(tk):
        x, y, theta = waypoints[int(tk / switch_time) % len(waypoints)]
        return {"reference": np.array([tk, x, y, 0.0, 0.0, 0.0, np.sin(theta / 2.0), np.cos(theta / 2.0)])}

    return ROSNode(
        node_name="waypoint_generator",
        callback=waypoint_callback,
        subscribes_to=[],
        publishes_to=[("reference", PoseStamped, "/reference")],
        rate_hz=rate_hz,
    )


def controller_node(Kv=0.5, Komega=1.5, rate_hz=50.0):
    def controller_callback(tk, reference, estimate):
        dx, dy = reference[1:3] - estimate[:2]
        error = heading(*reference[6:8]) - heading(*estimate[5:7])
        turn = np.arctan2(np.sin(error), np.cos(error))
        v, omega = np.clip(Kv * np.hypot(dx, dy), -0.22, 0.22), np.clip(Komega * turn, -2.84, 2.84)
        return {"cmd_vel": np.array([v, 0.0, 0.0, 0.0, 0.0, omega])}

    return ROSNode(
        node_name="velocity_controller",
        callback=controller_callback,
        subscribes_to=[("/reference", PoseStamped, "reference"), ("/estimate", Odometry, "estimate")],
        publishes_to=[("cmd_vel", Twist, "/cmd_vel")],
        rate_hz=rate_hz,
        required_topics={"reference", "estimate"},
    )


def simulator_node(dt=0.1, rate_hz=10.0, seed=0):
    state, rng = np.zeros(5), np.random.default_rng(seed)

    def simulator_callback(tk, cmd_vel):
        x, y, theta, v, omega = state
        state[:] = x + v * np.cos(theta) * dt, y + v * np.sin(theta) * dt, theta + omega * dt, cmd_vel[0], cmd_vel[5]
        x, y, theta, v, omega = state
        noise = rng.multivariate_normal(np.zeros(3), R)
        noise[2] += rng.choice([-0.3, 0.3]) if rng.random() < 0.02 else 0.0
        noisy = odometry(*(state[:3] + noise), theta, v, omega)
        return {"odom": noisy, "true_state": odometry(x, y, theta, theta, v, omega)}

    return ROSNode(
        node_name="turtlebot_simulator",
        callback=simulator_callback,
        subscribes_to=[("/cmd_vel", Twist, "cmd_vel")],
        publishes_to=[("odom", Odometry, "/odom"), ("true_state", Odometry, "/true_state")],
        rate_hz=rate_hz,
    )


def teleop_node(rate_hz=10.0):
    def teleop_callback(tk):
        v, omega = next(((v, omega) for until, v, omega in MANEUVERS if tk < until), (0.0, 0.0))
        return {"cmd_vel": np.array([v, 0.0, 0.0, 0.0, 0.0, omega])}

    return ROSNode(
        node_name="simulated_teleop",
        callback=teleop_callback,
        subscribes_to=[],
        publishes_to=[("cmd_vel", Twist, "/cmd_vel")],
        rate_hz=rate_hz,
    )


def logger_node(*names):
    """Return the logger, and the lists that it fills: those named of reference, cmd_vel, true_state, odom and estimate."""
    types = {"reference": PoseStamped, "cmd_vel": Twist, "true_state": Odometry, "odom": Odometry, "estimate": Odometry}
    log = {"time": [], **{name: [] for name in names}}

    def logger_callback(tk, **arrays):
        if len(arrays) == len(names):
            log["time"].append(tk)
            for name in names:
                log[name].append(arrays[name].copy())
        return {}

    node = ROSNode(
        node_name="data_logger",
        callback=logger_callback,
        subscribes_to=[(f"/{name}", types[name], name) for name in names],
        publishes_to=[],
        rate_hz=10.0,
    )
    return node, log
