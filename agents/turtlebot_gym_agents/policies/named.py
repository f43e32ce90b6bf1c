"""Policies by name: the built-in laws, the bundles that come with the package, files, and callables of one's own."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module, resources
from pathlib import Path
from typing import Any, cast

from turtlebot_gym.parameters import REFERENCE_PERIOD
from turtlebot_gym.presets import make_robot
from turtlebot_gym.robots import Robot
from turtlebot_gym_agents.policies.geometric import BearingPolicy, PolarPolicy, ProportionalPolicy, RotateDriveRotatePolicy
from turtlebot_gym_agents.policies.policy import Policy

POLICIES: dict[str, Callable[[Robot, float], Policy]] = {
    "proportional": lambda robot, dt: ProportionalPolicy(robot),
    "bearing": lambda robot, dt: BearingPolicy(robot, dt),
    "polar": lambda robot, dt: PolarPolicy(robot, dt),
    "rotate-drive-rotate": lambda robot, dt: RotateDriveRotatePolicy(robot, dt),
}
"""Makers of the built-in policies by name."""


def pretrained_folder() -> Path:
    """Return the folder with the bundles that come with the package."""
    installed = Path(str(resources.files("turtlebot_gym_agents"))) / "pretrained"
    return installed if installed.is_dir() else installed.parent.parent / "pretrained"


def make_policy(name: str, *, robot: str | Robot = "burger", dt: float = REFERENCE_PERIOD) -> Policy:
    """Return a policy by its name.

    Args:
        name: "proportional", "bearing", "polar" or "rotate-drive-rotate"; "ppo-nav", "ppo-pose" or "ppo-square", which come
            with the package; a bundle's file, ``*.onnx``; or "module:callable" for one of your own: a function is the policy
            itself, a class is made with ``robot`` and ``dt`` as keywords.
        robot: A name in `turtlebot_gym.ROBOTS`, or a robot.
        dt: Control interval, s.

    Raises:
        ValueError: If there is none of that name, or a bundle was trained for another robot or rate.
        ImportError: If a bundle is asked for and onnxruntime is missing.
    """
    if name in POLICIES:
        return POLICIES[name](make_robot(robot), dt)
    shipped = pretrained_folder() / f"{name}.onnx"
    if name.endswith(".onnx") or (name.isprintable() and "/" not in name and shipped.is_file()):
        from turtlebot_gym_agents.policies.bundle import BundlePolicy

        return BundlePolicy(name if name.endswith(".onnx") else shipped, robot=robot, dt=dt)
    if name.endswith((".zip", ".pkl", ".pt", ".pth")):
        raise ValueError(
            f"{name}: loading it can run code that it holds. If you trust it, make a bundle of it: "
            f"turtlebot-gym export {name} --allow-pickle"
        )
    module, colon, attribute = name.partition(":")
    known = f"policy must be one of {', '.join(map(repr, POLICIES))}, or 'module:callable', got {name!r}"
    if not (module and colon and attribute):
        raise ValueError(f"{known}.")
    try:
        found: Any = getattr(import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise ValueError(f"{known}: {error}.") from error
    if not callable(found):
        raise ValueError(f"{known}: it cannot be called.")
    return cast(Policy, found(robot=make_robot(robot), dt=dt) if isinstance(found, type) else found)
