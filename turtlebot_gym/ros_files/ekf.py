"""Noise from the parameters of robot_localization's ``ekf_node``.

References:
    robot_localization, branch jazzy-devel: ``src/ekf.cpp``, ``Ekf::predict``, which adds ``dt`` times the matrix
    ``process_noise_covariance`` in each prediction; ``src/filter_common.cpp`` and ``doc/state_estimation_nodes.rst`` for the
    order of the state and the defaults.
"""

from __future__ import annotations

from typing import Any

from turtlebot_gym.parameters import REFERENCE_PERIOD, Noise, OdometryNoise, ProcessNoise
from turtlebot_gym.ros_files.parameters import number

DEFAULT = (0.05, 0.05, 0.06, 0.03, 0.03, 0.06, 0.025, 0.025, 0.04, 0.01, 0.01, 0.02, 0.01, 0.01, 0.015)
"""The diagonal of ``process_noise_covariance`` by default: x, y, z, roll, pitch, yaw, their rates, and accelerations; per s."""
SPEED, TURN = 0.2, 1.0
"""Speed, m/s, and turning rate, rad/s, at which the noise here is that of the file: here it grows with both."""
_YAW_RATE, _SPEED, _POSE = 11, 6, (0, 1, 5)
_R = (0.05**2, 0.05**2, 0.1**2)


def read_ekf(nodes: dict[str, dict[str, Any]]) -> tuple[Noise, list[str], list[str]] | None:
    """Return a noise model from the first node that has an odometry, see `parameters.nodes_in`; None if there is none.

    Returns:
        The noise; what was taken; what was left out.

    Raises:
        ValueError: If the covariance is not a matrix of 15 x 15, or its diagonal, of numbers that are not negative.
    """
    node = next((name for name, parameters in nodes.items() if "odom0" in parameters or "odom0_config" in parameters), None)
    if node is None:
        return None
    parameters = nodes[node]
    given = parameters.get("process_noise_covariance")
    diagonal = _diagonal(given) if given is not None else list(DEFAULT)
    alpha1, alpha4 = diagonal[_SPEED] * REFERENCE_PERIOD / SPEED**2, diagonal[_YAW_RATE] * REFERENCE_PERIOD / TURN**2
    config = parameters.get("odom0_config")
    fused = [flag is True for flag in config] if isinstance(config, list) and len(config) == 15 else [False] * 15
    has_pose = any(fused[at] for at in _POSE) and parameters.get("odom0_differential") is not True
    odometry = OdometryNoise(R=_R) if has_pose else OdometryNoise(wheel=True)
    source = "process_noise_covariance" if given is not None else "its default, as none is stated"
    taken = [
        f"alpha1 {alpha1:.4g} and alpha4 {alpha4:.4g} (vx and vyaw of {source}, at {SPEED:g} m/s and {TURN:g} rad/s)",
        f"odometry measures {'the pose' if has_pose else 'only motion, as wheels do'} (odom0_config)",
    ]
    left_out = [
        "R, which messages state and this file does not" + (", so that of preset documented counts" if has_pose else "")
    ]
    left_out.append("process noise of the pose, which a simulated robot has by its motion alone")
    others = sorted(name for name in parameters if name[:-1] in ("odom", "pose", "twist", "imu") and name[-1:].isdecimal())
    if more := [name for name in others if name != "odom0"]:
        left_out.append(f"the sensors {', '.join(more)} (see --fix and --imu)")
    if thresholds := sorted(name for name in parameters if name.startswith("odom0") and name.endswith("threshold")):
        left_out.append(", ".join(thresholds))
    if parameters.get("dynamic_process_noise_covariance") is True:
        left_out.append("dynamic_process_noise_covariance")
    return Noise(process=ProcessNoise(alpha1=alpha1, alpha4=alpha4), odometry=odometry), taken, left_out


def _diagonal(values: Any) -> list[float]:
    numbers = [number(value) for value in values] if isinstance(values, list) else []
    if len(numbers) == 225:
        numbers = numbers[::16]
    checked = [value for value in numbers if value is not None and value >= 0.0]
    if len(numbers) != 15 or len(checked) != 15:
        raise ValueError(
            "process_noise_covariance must be 15 x 15 numbers or the 15 of its diagonal, none of them negative there"
        )
    return checked
