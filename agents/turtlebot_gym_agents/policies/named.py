"""Policies by name: baselines, bundles, files, and users' callables, which are checked."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.config import did_you_mean
from turtlebot_gym.files import failure, is_file, load_object
from turtlebot_gym.parameters import REFERENCE_PERIOD, Noise
from turtlebot_gym.presets import make_robot
from turtlebot_gym.robots import Robot
from turtlebot_gym_agents.policies.baselines import POLICIES, SUFFIXES, load_baseline
from turtlebot_gym_agents.policies.policy import Policy, Wrapped, numbers_of, terms_of
from turtlebot_gym_agents.policies.protection import within_layer
from turtlebot_gym_agents.policies.yielding import Yielding

SAFETY = "+safety"
"""Suffix of a policy's name that wraps it in a `SafetyLayer`."""
YIELD = "+yield"
"""Suffix that lets it stop for people, see `Yielding`."""


def bare(name: str) -> str:
    """Return a policy's name without the suffixes of its wrappers."""
    while name.endswith((SAFETY, YIELD)):
        name = name.removesuffix(SAFETY).removesuffix(YIELD)
    return name


def pretrained_folder() -> Path:
    """Return the folder with the bundles shipped with the package."""
    return shipped_folder("pretrained")


def shipped_folder(name: str) -> Path:
    """Return a folder that is shipped with the package: inside it if installed, beside it in a checkout."""
    installed = Path(str(resources.files("turtlebot_gym_agents"))) / name
    return installed if installed.is_dir() else installed.parent.parent / name


def bundle_of(name: str) -> Path | None:
    """Return the file of a bundle by its path or its name in the package; None for other policies."""
    shipped = pretrained_folder() / f"{name}.onnx"
    if name.endswith(".onnx"):
        return Path(name)
    return shipped if name.isprintable() and "/" not in name and shipped.is_file() else None


def make_policy(
    name: str | Path,
    *,
    robot: str | Robot = "burger",
    dt: float = REFERENCE_PERIOD,
    noise: str | Noise = "clean",
    allow_mismatch: bool = False,
) -> Policy:
    """Return a policy by its name.

    Args:
        name: A baseline: "proportional", "bearing" or "corner", for rooms "vfh" or "planner"; a file of one with other numbers,
            ``*.yaml`` (see `baselines`); "ppo-nav", "ppo-pose", "ppo-square" or "ppo-rooms", shipped with the package; a
            bundle's file, ``*.onnx``; or "module:callable" for one of your own: a function is the policy itself, a class is
            instantiated with ``robot`` and ``dt`` as keywords. In rooms, the suffix "+safety" wraps any of them in a
            `SafetyLayer`, and "+yield" lets it stop for people who are tracked.
        robot: A name in `turtlebot_gym.ROBOTS`, or a robot.
        dt: Control interval, s.
        noise: Noise of the motion, which a `SafetyLayer` allows for.
        allow_mismatch: Whether a bundle or a tuned baseline that was made for another robot or rate may drive. Its actions are
            shares of the robot's limits.

    Raises:
        ValueError: If the name is unknown, or a file was made for another robot or rate.
        ImportError: If the policy is a bundle and onnxruntime is missing.
    """
    name = str(name)
    if name.endswith(SAFETY):
        driver = make_policy(name.removesuffix(SAFETY), robot=robot, dt=dt, noise=noise, allow_mismatch=allow_mismatch)
        return within_layer(driver, robot, dt, noise=noise)
    if name.endswith(YIELD):
        driver = make_policy(name.removesuffix(YIELD), robot=robot, dt=dt, noise=noise, allow_mismatch=allow_mismatch)
        return Yielding(driver, robot, dt)
    if name in POLICIES:
        return POLICIES[name](make_robot(robot), dt)
    fit: dict[str, Any] = {} if allow_mismatch else {"robot": robot, "dt": dt}
    if name.endswith(SUFFIXES):
        return load_baseline(name, **({"robot": robot, "dt": dt} if is_file(name) else fit))
    if bundle := bundle_of(name):
        from turtlebot_gym_agents.policies.bundle import BundlePolicy

        return BundlePolicy(bundle, **fit)
    if name.endswith((".zip", ".pkl", ".pt", ".pth")):
        raise ValueError(
            f"{name}: loading it can run code that it holds. If you trust it, make a bundle of it: `turtlebot-gym export` of a "
            "training by this package, or export(model, ...) in Python."
        )
    if not all(name.partition(":")):
        names = (*POLICIES, *sorted(path.stem for path in pretrained_folder().glob("*.onnx")))
        refusal = f"policy must be one of {', '.join(map(repr, names))}, FILE.onnx, FILE.yaml, FILE.json or 'module:callable'"
        raise ValueError(f"{refusal}, got {name!r}.{did_you_mean(name, names)}")
    try:
        return _load_own(name, make_robot(robot), dt)
    except ValueError as error:
        raise ValueError(f"policy {name!r}: {error}") from error


def _load_own(name: str, robot: Robot, dt: float) -> Policy:
    """Import "module:callable"; a class is instantiated with ``robot`` and ``dt``."""
    policy = load_object(name)
    if not callable(policy):
        raise ValueError("it cannot be called.")
    try:
        return _Own(name, policy(robot=robot, dt=dt) if isinstance(policy, type) else policy)
    except Exception as error:
        raise failure(name, error) from error


class _Own(Wrapped):
    """A policy whose actions are checked, and whose errors become one line that says where it failed."""

    def __init__(self, name: str, policy: Any) -> None:
        super().__init__(policy)
        self._name, self._terms = name, terms_of(policy)

    def __call__(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return actions (..., 2) for observations (..., n).

        Raises:
            ValueError: If the observations are not of the terms that the policy reads, or it raises, or does not return as many
                pairs of finite numbers.
        """
        if self._terms is not None:
            try:
                observations = numbers_of(observations, self._terms)
            except ValueError as error:
                raise ValueError(f"{self._name}: {error}") from error
        try:
            answer = self._policy(observations)
        except Exception as error:
            raise failure(self._name, error) from error
        shape = (*np.shape(observations)[:-1], 2)
        try:
            actions = np.asarray(answer, np.float32)
        except (TypeError, ValueError) as error:
            raise ValueError(f"{self._name}: it must return numbers, got {type(answer).__name__}.") from error
        if actions.shape != shape:
            raise ValueError(f"{self._name}: it must return an array of shape {shape}, got {actions.shape}.")
        if not np.isfinite(actions).all():
            raise ValueError(f"{self._name}: it must return finite numbers, got {actions[~np.isfinite(actions)][0]}.")
        return actions
