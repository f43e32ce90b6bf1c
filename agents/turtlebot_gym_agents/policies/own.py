"""Users' own policies, ``module:callable``: errors in them are reported with their file and line."""

from __future__ import annotations

import traceback
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.robots import Robot


def load_own(name: str, robot: Robot, dt: float) -> OwnPolicy:
    """Import a policy; a class is instantiated with ``robot`` and ``dt`` as keywords.

    Args:
        name: "module:callable".
        robot: The robot to drive.
        dt: Control interval, s.

    Raises:
        ValueError: If there is no such callable, or importing or instantiating it fails.
    """
    module, _, attribute = name.partition(":")
    try:
        found: Any = getattr(import_module(module), attribute)
    except (ModuleNotFoundError, AttributeError) as error:
        raise ValueError(f"{error}.") from error
    except Exception as error:
        raise ValueError(_told(name, error)) from error
    if not callable(found):
        raise ValueError("it cannot be called.")
    try:
        return OwnPolicy(name, found(robot=robot, dt=dt) if isinstance(found, type) else found)
    except Exception as error:
        raise ValueError(_told(name, error)) from error


class OwnPolicy:
    """A policy whose actions are checked, and whose errors become one line that says where it failed.

    It has all the attributes of the wrapped policy, including ``reset`` and ``layout``.

    Args:
        name: Name of the policy in messages.
        policy: A callable from observations (..., n) to actions (..., 2).
    """

    def __init__(self, name: str, policy: Any) -> None:
        self._name, self._policy = name, policy

    def __getattr__(self, attribute: str) -> Any:
        if attribute.startswith("_"):
            raise AttributeError(attribute)
        return getattr(self._policy, attribute)

    def __call__(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return actions (..., 2) for observations (..., n).

        Raises:
            ValueError: If the policy raises, or does not return as many pairs of finite numbers.
        """
        try:
            answer = self._policy(observations)
        except Exception as error:
            raise ValueError(_told(self._name, error)) from error
        wanted = (*np.shape(observations)[:-1], 2)
        try:
            actions = np.asarray(answer, np.float32)
        except (TypeError, ValueError) as error:
            raise ValueError(f"{self._name}: it must return numbers, got {type(answer).__name__}.") from error
        if actions.shape != wanted:
            raise ValueError(f"{self._name}: it must return an array of shape {wanted}, got {actions.shape}.")
        if not np.isfinite(actions).all():
            raise ValueError(f"{self._name}: it must return finite numbers, got {actions[~np.isfinite(actions)][0]}.")
        return actions


def _told(name: str, error: Exception) -> str:
    """Describe an error in a user's code on one line, with its place."""
    if isinstance(error, SyntaxError):
        return f"{name}: SyntaxError: {error.msg} ({error.filename}, line {error.lineno})."
    frames = traceback.extract_tb(error.__traceback__)
    theirs = [frame for frame in frames if frame.filename != __file__ and "site-packages" not in frame.filename]
    frame = (theirs or frames)[-1]
    return f"{name}: {type(error).__name__}: {' '.join(str(error).split())} ({frame.filename}, line {frame.lineno})."
