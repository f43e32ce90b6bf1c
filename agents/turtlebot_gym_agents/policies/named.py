"""Policies by name: baselines, bundles, files, and users' callables, which are checked.

A file of a baseline is YAML with its name and some of its fields, such as ``{policy: proportional, kv: 0.8}``.
"""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.config import build, choose, did_you_mean
from turtlebot_gym.files import failure, is_file, load, load_object
from turtlebot_gym.parameters import REFERENCE_PERIOD, Noise
from turtlebot_gym.presets import make_robot
from turtlebot_gym.robots import Robot
from turtlebot_gym_agents.policies.geometric import Baseline, BearingPolicy, CornerPolicy, ProportionalPolicy
from turtlebot_gym_agents.policies.planner import PlannerPolicy
from turtlebot_gym_agents.policies.policy import Policy, Wrapped, numbers_of, terms_of
from turtlebot_gym_agents.policies.protection import within_layer
from turtlebot_gym_agents.policies.reactive import VectorFieldHistogramPolicy
from turtlebot_gym_agents.policies.yielding import Yielding

POLICIES: dict[str, type[Baseline]] = {
    "proportional": ProportionalPolicy,
    "bearing": BearingPolicy,
    "corner": CornerPolicy,
    "vfh": VectorFieldHistogramPolicy,
    "planner": PlannerPolicy,
}
"""Baselines by name; the last two are for rooms."""
SAFETY = "+safety"
"""Suffix of a policy's name that wraps it in a `SafetyLayer`."""
YIELD = "+yield"
"""Suffix that lets it stop for people, see `Yielding`."""


def bare(name: str) -> str:
    """Return a policy's name without the suffixes of its wrappers."""
    while name.endswith((SAFETY, YIELD)):
        name = name.removesuffix(SAFETY).removesuffix(YIELD)
    return name


def shipped_folder(name: str) -> Path:
    """Return a folder that is shipped with the package: inside it if installed, beside it in a checkout."""
    installed = Path(str(resources.files("turtlebot_gym_agents"))) / name
    return installed if installed.is_dir() else installed.parent.parent / name


def bundle_of(name: str) -> Path | None:
    """Return the file of a bundle by its path or its name in the package; None for other policies."""
    shipped = shipped_folder("pretrained") / f"{name}.onnx"
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
            ``*.yaml``; "ppo-nav", "ppo-pose", "ppo-square" or "ppo-rooms", shipped with the package; a
            bundle's file, ``*.onnx``; or "module:callable" for one of your own: a function is the policy itself, a class is
            instantiated with ``robot`` and ``dt`` as keywords. In rooms, the suffix "+safety" wraps any of them in a
            `SafetyLayer`, and "+yield" lets it stop for people who are tracked.
        robot: A name in `turtlebot_gym.ROBOTS`, or a robot.
        dt: Control interval, s.
        noise: Noise of the motion, which a `SafetyLayer` allows for.
        allow_mismatch: Whether a bundle that was made for another robot or rate may drive. Its actions are shares of the
            robot's limits.

    Raises:
        ValueError: If the name is unknown, or a file was made for another robot or rate.
        ImportError: If the policy is a bundle and onnxruntime is missing.
    """
    name = str(name)
    for suffix in (SAFETY, YIELD):
        if name.endswith(suffix):
            driver = make_policy(name.removesuffix(suffix), robot=robot, dt=dt, noise=noise, allow_mismatch=allow_mismatch)
            return within_layer(driver, robot, dt, noise=noise) if suffix == SAFETY else Yielding(driver, robot, dt)
    if name in POLICIES:
        return POLICIES[name](make_robot(robot), dt)
    if is_file(name):
        return _load_baseline(name, robot=robot, dt=dt)
    if bundle := bundle_of(name):
        from turtlebot_gym_agents.policies.bundle import BundlePolicy

        return BundlePolicy(bundle) if allow_mismatch else BundlePolicy(bundle, robot=robot, dt=dt)
    if name.endswith((".zip", ".pkl", ".pt", ".pth")):
        raise ValueError(
            f"{name}: loading it can run code that it holds. If you trust it, make a bundle of it: `turtlebot-gym export` of a "
            "training by this package, or export(model, ...) in Python."
        )
    if not all(name.partition(":")):
        names = (*POLICIES, *sorted(path.stem for path in shipped_folder("pretrained").glob("*.onnx")))
        refusal = f"policy must be one of {', '.join(map(repr, names))}, FILE.onnx, FILE.yaml or 'module:callable'"
        raise ValueError(f"{refusal}, got {name!r}.{did_you_mean(name, names)}")
    try:
        policy = load_object(name)
        if not callable(policy):
            raise ValueError("it cannot be called.")
        try:
            return _Own(name, policy(robot=make_robot(robot), dt=dt) if isinstance(policy, type) else policy)
        except Exception as error:  # it is somebody else's
            raise failure(name, error) from error
    except ValueError as error:
        raise ValueError(f"policy {name!r}: {error}") from error


def _load_baseline(path: str | Path, *, robot: str | Robot, dt: float) -> Policy:
    """Return the baseline of a file for a robot and a control interval, s; a file that is none is refused."""
    try:
        content: Any = load(path)
        if not isinstance(content, dict) or "policy" not in content:
            raise ValueError("it must have the policy's name, such as policy: proportional, and fields of it, such as kv: 0.8.")
        kind = choose("policy", content.pop("policy"), POLICIES)
        for field in {"robot", "dt"} & content.keys():
            raise ValueError(f"{field} must be left out: it is that of the environment or of the node.")
        return build(kind, {"robot": robot, "dt": dt, **content}, "policy")
    except (ValueError, TypeError, OSError) as error:
        raise ValueError(f"{path} is not a baseline: {' '.join(str(error).split())}") from error


class _Own(Wrapped):
    """A policy whose actions are checked, and whose errors become one line that says where it failed."""

    def __init__(self, name: str, policy: Any) -> None:
        super().__init__(policy)
        self._name, self._terms = name, terms_of(policy)

    def __call__(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return actions (..., 2) for observations (..., n), or refuse what the policy returns."""
        try:
            seen = observations if self._terms is None else numbers_of(observations, self._terms)
        except ValueError as error:
            raise ValueError(f"{self._name}: {error}") from error
        try:
            answer = self._policy(seen)
        except Exception as error:
            raise failure(self._name, error) from error
        shape = (*np.shape(seen)[:-1], 2)
        try:
            actions = np.asarray(answer, np.float32)
        except (TypeError, ValueError) as error:
            raise ValueError(f"{self._name}: it must return numbers, got {type(answer).__name__}.") from error
        if actions.shape != shape:
            raise ValueError(f"{self._name}: it must return an array of shape {shape}, got {actions.shape}.")
        if not np.isfinite(actions).all():
            raise ValueError(f"{self._name}: it must return finite numbers, got {actions[~np.isfinite(actions)][0]}.")
        return actions
