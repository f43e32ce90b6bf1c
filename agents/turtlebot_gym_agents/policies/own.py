"""Users' own policies, ``module:callable``: their answers are checked."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.own import failure, load_object
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
    policy = load_object(name)
    if not callable(policy):
        raise ValueError("it cannot be called.")
    try:
        return OwnPolicy(name, policy(robot=robot, dt=dt) if isinstance(policy, type) else policy)
    except Exception as error:
        raise failure(name, error) from error


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
