"""Test whether a native vector environment keeps Gymnasium's contract.

Gymnasium tests scalar environments with ``check_env`` and offers no such test for `VectorEnv`. `check_vector_env` makes
a few small environments, steps them, and compares them with themselves, with batches of one, and across autoreset
modes.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from typing import NamedTuple

from gymnasium.vector import AutoresetMode, VectorEnv

from gymnasium_vector_checker.rules import RULES
from gymnasium_vector_checker.runs import LIMIT, Case, difference


class Violation(NamedTuple):
    """A rule that an environment breaks."""

    rule: str
    """Name of the rule."""
    mode: AutoresetMode
    """Autoreset mode in which it was broken."""
    text: str
    """Text of the rule."""
    seen: str
    """What the environment did instead."""


class ContractError(AssertionError):
    """Raised by `check_vector_env` when an environment breaks rules of the contract; all of them are in ``violations``."""

    def __init__(self, violations: list[Violation]) -> None:
        self.violations = violations
        lines = [f"- {broken.rule} ({broken.mode.name}): {broken.text}\n  Seen: {broken.seen}" for broken in violations]
        super().__init__("\n".join([f"{len(violations)} rules of the vector environment's contract are broken:", *lines]))


def check_vector_env(
    make: Callable[..., VectorEnv],
    *,
    modes: Iterable[AutoresetMode] | None = None,
    num_envs: int = 3,
    steps: int = 40,
) -> tuple[AutoresetMode, ...]:
    """Test a native vector environment against Gymnasium's contract.

    Args:
        make: Called as ``make(num_envs=..., autoreset_mode=...)``, and with ``max_episode_steps`` where it has a parameter of
            that name or ``**kwargs``, such as ``functools.partial(gymnasium.make_vec, "my/Env-v0")``.
        modes: The autoreset modes that the environment must support; None for those for which ``make`` raises no error
            (TypeError, ValueError, NotImplementedError or one of Gymnasium's).
        num_envs: Size of the batches, at least 2.
        steps: Length of the runs. Without ``max_episode_steps`` an episode must end within it.

    Returns:
        The tested modes.

    Raises:
        ContractError: If rules are broken; it lists all of them.
        ValueError: If no mode is left to test, or ``num_envs`` is below 2.
    """
    if num_envs < 2:
        raise ValueError(f"num_envs must be at least 2, got {num_envs!r}.")
    parameters = inspect.signature(make).parameters
    limited = "max_episode_steps" in parameters or any(
        parameter.kind is parameter.VAR_KEYWORD for parameter in parameters.values()
    )
    wanted = tuple(AutoresetMode) if modes is None else tuple(modes)
    cases = [Case(make, mode, num_envs, steps, LIMIT if limited else None) for mode in wanted]
    if modes is None:
        cases = [case for case in cases if case.supported()]
    if not cases:
        raise ValueError(f"modes must name at least one that make supports, got {wanted!r}.")
    violations = []
    for case in cases:
        for rule in (*RULES[None], *RULES[case.mode]):
            try:
                seen = next(rule(case), None)
            except Exception as error:  # any error at all breaks the rule
                seen = f"it raised {error!r}."
            if seen is not None:
                violations.append(Violation(rule.__name__, case.mode, " ".join((rule.__doc__ or "").split()), seen))
    if not violations:
        first, *others = ((case.mode, case.play(1)) for case in cases)
        text = "Episodes are the same in every autoreset mode."
        seen = ((mode, difference(first[1], events)) for mode, events in others)
        violations = [Violation("modes_agree", mode, text, what) for mode, what in seen if what is not None]
    if violations:
        raise ContractError(violations)
    return tuple(case.mode for case in cases)
