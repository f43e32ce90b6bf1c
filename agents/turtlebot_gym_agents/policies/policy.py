"""A policy is any callable from observations (..., n) to actions (..., 2); one with memory also has ``reset(mask)``.

Its attribute ``terms`` names the terms of the observation that it reads, in that order, as in ``("goal", "scan*2",
"bumper:BUMPER")``. A policy without the attribute is shown all that an environment observes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.observations import LOCATED_ROOM, OPEN_GROUND, ROOM, SCAN, ObservationTerm
from turtlebot_gym.observations.columns import columns_of, size_of
from turtlebot_gym.observations.reading import read_terms


class Policy(Protocol):
    """A callable from observations to actions."""

    def __call__(self, observations: NDArray[np.float32], /) -> NDArray[np.float32]:
        """Return actions (..., 2) in [-1, 1], shares of the robot's limits, for observations (..., n)."""
        ...


@runtime_checkable
class PolicyWithMemory(Policy, Protocol):
    """A policy with memory."""

    def reset(self, mask: NDArray[np.bool_], /) -> None:
        """Clear the memory where the mask (...) is true, because an episode begins there."""
        ...


def terms_of(policy: object) -> tuple[ObservationTerm, ...] | None:
    """Return the terms that a policy, or a class of policies, reads; None if it reads whatever it is shown."""
    terms = getattr(policy, "terms", None)
    if terms is None or all(isinstance(term, ObservationTerm) for term in terms):
        return terms
    return read_terms(tuple(terms), ())


def numbers_of(observations: ArrayLike, terms: Sequence[ObservationTerm]) -> NDArray[Any]:
    """Return the numbers of some terms from observations (..., n) of these terms, or of one of the package's that has them."""
    rows, sizes = np.asarray(observations), [size_of(terms)]
    if rows.ndim and rows.shape[-1] == sizes[0]:
        return rows
    for shown in (OPEN_GROUND, ROOM, LOCATED_ROOM):
        if {term.name for term in terms} <= {term.name for term in shown}:
            sizes.append(size_of(shown))
            if rows.ndim and rows.shape[-1] == sizes[-1]:
                return rows[..., columns_of(terms, shown)]
    names, shapes = ", ".join(term.spelled for term in terms), " or ".join(f"(..., {size})" for size in sorted({*sizes}))
    raise ValueError(f"observations must have shape {shapes}, with {names}, got {rows.shape}.")


def with_room(policy: object) -> tuple[ObservationTerm, ...]:
    """Return the terms of a room, and after them the others that a policy reads; refuse one that was made without a scan."""
    own = terms_of(policy) or ROOM
    if hasattr(policy, "card") and SCAN.name not in {term.name for term in own}:
        raise ValueError("the policy reads no scan, and sees no obstacles.")
    extended = {term.name: term for term in (*ROOM, *own)}
    return own if [*extended] == [term.name for term in own] else tuple(extended.values())


class Wrapped:
    """Base of policies that wrap another one, and have all its attributes, such as ``reset`` and ``terms``."""

    def __init__(self, policy: Any) -> None:
        self._policy = policy
        # From Python 3.12 on, `isinstance` of a protocol does not ask `__getattr__`.
        if hasattr(policy, "reset") and not hasattr(type(self), "reset"):
            self.reset = policy.reset

    def __getattr__(self, attribute: str) -> Any:
        if attribute.startswith("_"):
            raise AttributeError(attribute)
        return getattr(self._policy, attribute)


class _Selecting(Wrapped):
    """A policy that is shown the terms that it reads, of more."""

    def __init__(self, policy: Any, columns: NDArray[np.intp]) -> None:
        super().__init__(policy)
        self._columns = columns

    def __call__(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        return self._policy(np.asarray(observations)[..., self._columns])


def shown(policy: Policy, name: str, terms: Sequence[ObservationTerm]) -> Policy:
    """Return a policy that reads its terms in observations of other ones.

    A term that is not there is refused, with its name and the policy's.
    """
    own = terms_of(policy)
    if own is None:
        return policy
    try:
        columns = columns_of(own, terms)
    except ValueError as error:
        raise ValueError(f"{name}: {error}: name it in observation=...") from error
    return policy if len(columns) == size_of(terms) and (columns[:-1] < columns[1:]).all() else _Selecting(policy, columns)
