"""A robot's limits and footprint from Nav2's parameters.

References:
    Nav2, branch jazzy: ``nav2_velocity_smoother/src/velocity_smoother.cpp``, ``nav2_dwb_controller/dwb_plugins/src/
    kinematic_parameters.cpp``, ``nav2_mppi_controller/src/optimizer.cpp``, ``nav2_regulated_pure_pursuit_controller/src/
    parameter_handler.cpp``, ``nav2_graceful_controller/src/parameter_handler.cpp``, and ``nav2_costmap_2d/src/
    costmap_2d_ros.cpp``, where a footprint comes before a radius.
"""

from __future__ import annotations

import math
from ast import literal_eval
from typing import Any, NamedTuple

import numpy as np

from turtlebot_gym.ros_files.footprints import enclosing_circle
from turtlebot_gym.ros_files.parameters import number


class _Names(NamedTuple):
    """Names of a controller's parameters; empty for one that it does not have."""

    fastest: str
    slowest: str
    turning: str
    acceleration: str = ""
    turning_acceleration: str = ""
    reverses: str = ""
    """Whether the robot may drive backwards, by default not."""


_CONTROLLERS = {
    "DWB": _Names("max_vel_x", "min_vel_x", "max_vel_theta", "acc_lim_x", "acc_lim_theta"),
    "MPPI": _Names("vx_max", "vx_min", "wz_max", "ax_max", "az_max"),
    "RegulatedPurePursuit": _Names("desired_linear_vel", "", "", "", "max_angular_accel", "allow_reversing"),
    "Graceful": _Names("v_linear_max", "", "v_angular_max", reverses="allow_backward"),
    "Teb": _Names("max_vel_x", "", "max_vel_theta", "acc_lim_x", "acc_lim_theta"),
}
"""Parameters of controllers by a part of the plugin's name."""


def read_nav2(nodes: dict[str, dict[str, Any]]) -> tuple[dict[str, Any], list[str], list[str]]:
    """Return fields of a `turtlebot_gym.Robot` from Nav2's parameters, see `parameters.nodes_in`.

    Where controller and velocity smoother limit the same, the lower limit counts.

    Returns:
        The fields, empty if there are none; what was taken; what was left out.

    Raises:
        ValueError: If the footprint is malformed.
    """
    limits: dict[str, list[tuple[float, str]]] = {}
    backwards: list[float] = []
    left_out: list[str] = []
    smoother = nodes.get("velocity_smoother", {})
    for name, field, at in (
        ("max_velocity", "max_linear", 0),
        ("max_velocity", "max_angular", -1),
        ("max_accel", "max_linear_acceleration", 0),
        ("max_accel", "max_angular_acceleration", -1),
    ):
        _limit(limits, field, _entry(smoother.get(name), at), f"velocity_smoother.{name}")
    if (slowest := _entry(smoother.get("min_velocity"), 0)) is not None:
        backwards.append(slowest)
    controllers = nodes.get("controller_server", {})
    for plugin in controllers.get("controller_plugins", ["FollowPath"]) or ():
        _controller(controllers, str(plugin), limits, backwards, left_out)
    fields = {field: min(values)[0] for field, values in limits.items()}
    taken = [f"{field} {min(values)[0]:g} ({min(values)[1]})" for field, values in limits.items()]
    if "max_linear" in fields:
        fields |= {"max_wheel": math.inf}
        if backwards:
            fields["reverse"] = max(backwards) < 0.0
            taken.append(f"reverse {'yes' if fields['reverse'] else 'no'}")
            if fields["reverse"] and -max(backwards) not in (math.inf, fields["max_linear"]):
                left_out.append(f"another limit backwards, {-max(backwards):g} m/s")
    if _entry(smoother.get("max_decel"), 0) not in (None, -fields.get("max_linear_acceleration", math.inf)):
        left_out.append("max_decel")
    shape, text = _footprint(nodes)
    return fields | shape, taken + ([text] if text else []), left_out


def _limit(limits: dict[str, list[tuple[float, str]]], field: str, value: float | None, source: str) -> None:
    """Note a limit; 0, which Nav2 takes for none, and negative numbers are none."""
    if value is not None and value > 0.0:
        limits.setdefault(field, []).append((value, source))


def _entry(values: Any, at: int) -> float | None:
    """Return one of 3 (x, y, theta) or 6 (x, y, z, roll, pitch, yaw) numbers."""
    return number(values[at]) if isinstance(values, list) and len(values) in (3, 6) else None


def _controller(
    parameters: dict[str, Any],
    name: str,
    limits: dict[str, list[tuple[float, str]]],
    backwards: list[float],
    left_out: list[str],
) -> None:
    """Note the limits of a controller's plugin."""
    plugin = str(parameters.get(f"{name}.plugin", ""))
    if "RotationShim" in plugin:
        plugin = str(parameters.get(f"{name}.primary_controller", ""))
    names = next((names for part, names in _CONTROLLERS.items() if part.lower() in plugin.lower()), None)
    if names is None:
        if plugin:
            left_out.append(f"the controller {plugin}, which is not known here")
        return

    def of(parameter: str) -> float | None:
        return number(parameters.get(f"{name}.{parameter}")) if parameter else None

    for field, parameter in (
        ("max_linear", names.fastest),
        ("max_angular", names.turning),
        ("max_linear_acceleration", names.acceleration),
        ("max_angular_acceleration", names.turning_acceleration),
    ):
        _limit(limits, field, of(parameter), f"{name}.{parameter}")
    slowest = of(names.slowest)
    if slowest is not None:
        backwards.append(slowest)
    elif names.reverses:
        backwards.append(-math.inf if parameters.get(f"{name}.{names.reverses}") is True else 0.0)
    if (model := str(parameters.get(f"{name}.motion_model", "DiffDrive"))).lower().replace("_", "") != "diffdrive":
        left_out.append(f"the motion model {model}: a robot here drives by two wheels")


def _footprint(nodes: dict[str, dict[str, Any]]) -> tuple[dict[str, float], str]:
    """Return radius and centre of the footprint, and what was taken."""
    for costmap in ("local_costmap", "global_costmap"):
        parameters = nodes.get(costmap, {})
        polygon = parameters.get("footprint")
        if isinstance(polygon, str) and polygon.strip() not in ("", "[]"):
            x, radius = enclosing_circle(_polygon(polygon))
            return {"radius": radius, "footprint_x": x}, f"radius {radius:.3g} around x = {x:.3g} ({costmap}.footprint)"
        if (radius := number(parameters.get("robot_radius"))) is not None:
            return {"radius": radius, "footprint_x": 0.0}, f"radius {radius:g} ({costmap}.robot_radius)"
    return {}, ""


def _polygon(text: str) -> Any:
    try:
        corners = np.array(literal_eval(text.strip()), float)
    except (SyntaxError, ValueError, TypeError, MemoryError, RecursionError) as error:
        raise ValueError(f"the footprint must be a list of corners [[x, y], ...], got {text!r}") from error
    if corners.ndim != 2 or corners.shape[0] < 3 or corners.shape[1] != 2 or not np.isfinite(corners).all():
        raise ValueError(f"the footprint must be a list of corners [[x, y], ...], got {text!r}")
    return corners
