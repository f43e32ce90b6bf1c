"""The option ``observation``: from names to terms."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

from turtlebot_gym.config import choose, refusal
from turtlebot_gym.files import load_object
from turtlebot_gym.kernel import kernel
from turtlebot_gym.observations import OBSERVED, TERMS
from turtlebot_gym.observations.term import ObservationTerm

_HISTORY = re.compile(r"(.+?)\*(\d+)(?:@(\d+))?")


def read_items(observation: Any) -> tuple[str, tuple[str, ...]]:
    """Return the pose that a policy observes, a name in `OBSERVED`, and the names of terms beside it.

    The option is names with commas, or several names; a term of one's own may stand for its name. A ``ValueError`` refuses
    anything else, and several poses.
    """
    given = observation.split(",") if isinstance(observation, str) else observation
    given = [given] if isinstance(given, ObservationTerm) else given
    if not isinstance(given, (list, tuple)) or not given or not all(isinstance(item, (str, ObservationTerm)) for item in given):
        raise refusal("observation", "names of terms with commas, such as 'ekf,scan*2,MODULE:NAME'", observation)
    items = tuple(item.strip() if isinstance(item, str) else _spelled(item) for item in given)
    poses = [item for item in items if item in OBSERVED]
    if len(poses) > 1:
        raise refusal("observation", "terms with one pose", observation)
    return (poses or ["ekf"])[0], items


def _spelled(term: ObservationTerm) -> str:
    return (term if TERMS.get(term.name) == term.over(1) else term.sourced()).spelled


def read_terms(items: Sequence[str], own: Sequence[ObservationTerm]) -> tuple[ObservationTerm, ...]:
    """Return the terms that an observation names: "ekf" or another pose for a system's ``own``, a term, or "MODULE:NAME".

    With "*N" a term shows its last N values, with "*N@K" each K steps before the next. Such a history replaces the term that
    was named before it.
    A ``ValueError`` refuses a term that does not exist, or is named twice.
    """
    terms: dict[str, ObservationTerm] = {}
    known = dict.fromkeys(OBSERVED) | TERMS | {term.name: term for term in own}
    for item in items:
        match = _HISTORY.fullmatch(item)
        name, length, every = match.groups() if match else (item, None, None)
        found = own_term(name) if ":" in name else choose("a term of observation (MODULE:NAME for your own)", name, known)
        for term in [found] if found else own:
            if (before := terms.get(term.name)) and not (match and before == term):
                raise ValueError(f"observation has the term {term.name!r} twice: leave out one of them.")
            terms[term.name] = term.over(int(length or 1), every=int(every or 1)) if match else term
    if all(term.in_scene for term in terms.values()):
        raise ValueError(f"observation must have a term beside {', '.join(map(repr, terms))}, such as 'goal'.")
    return tuple(terms.values())


def own_term(source: str) -> ObservationTerm:
    """Return a term of one's own, "MODULE:NAME"; a ``ValueError`` refuses one that has the name of one of the package's."""
    term = load_object(source)
    if not isinstance(term, ObservationTerm):
        raise refusal(f"observation {source!r}", "a turtlebot_gym.observations.ObservationTerm", term)
    if term.name in TERMS or term.name in OBSERVED:
        raise ValueError(f"observation {source!r}: the package has a term {term.name!r} already: give yours another name.")
    if term.in_scene:
        raise ValueError(f"observation {source!r}: in_scene is for the package's own terms: return numbers of the world.")
    return _clipped(replace(term, source=source))


@cache
def _clipped(term: ObservationTerm) -> ObservationTerm:
    """Return a term whose numbers are within its bounds; the kernel's attribute ``__wrapped__`` is the one before."""
    of, bounds = term.of, tuple(zip(*term.bounds, strict=True))

    def of_one(world, p):
        return min(max(of(world, p), bounds[0][0]), bounds[0][1])

    def of_several(world, p):
        return tuple(min(max(number, low), high) for number, (low, high) in zip(of(world, p), bounds, strict=True))

    clipped: Any = kernel(of_one if term.width == 1 else of_several)
    clipped.__wrapped__ = of
    return replace(term, of=clipped)
