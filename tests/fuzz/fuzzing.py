"""What the fuzz tests share: how many inputs, limits of time and memory for each, and what counts as an answer."""

import math
import resource
import signal
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

FOLDER = Path(tempfile.mkdtemp(prefix="fuzz-"))
"""Folder for the files that the tests write."""
LIMIT = 60.0
"""Longest time that an input may take, s: a hang takes longer, and a busy machine less."""
WORK = 10.0
"""Longest CPU time that an input may take, s, once what it runs is compiled: one that takes more is tried again."""
GROWTH = 2**29
"""Most memory by which an input may raise the peak of the process, bytes."""
COUNTED: Counter[str] = Counter()
"""Inputs by kind and answer; `conftest` prints them."""
LONGEST: dict[str, float] = {}
"""Longest CPU time of an input by kind, s."""


def peak() -> int:
    """Return the most memory that this process has held, bytes."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


class Hang(BaseException):
    """An input takes longer than `LIMIT`."""


@contextmanager
def limited() -> Iterator[None]:
    """Raise `Hang` where the block takes too long; in the main thread only."""

    def stop(*_: object) -> None:
        raise Hang

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, LIMIT)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def answered(kind: str, call: Callable[[], Any]) -> Any:
    """Return what a call returns, or None where it refuses its input with one line of a reasonable length.

    Anything else that it raises fails the test.
    """
    for _ in range(2):
        message, result = None, None
        held, since = peak(), time.process_time()
        with limited():
            try:
                result = call()
            except (ValueError, OSError) as error:
                message = str(error)
        took, grown = time.process_time() - since, peak() - held
        if took < WORK:
            break
    assert took < WORK, f"{kind}: {took:.1f} CPU s"
    assert grown < GROWTH, f"{kind}: {grown / 1e6:.0f} MB"
    LONGEST[kind] = max(took, LONGEST.get(kind, 0.0))
    COUNTED[f"{kind}: {'taken' if message is None else 'refused'}"] += 1
    if message is not None:
        assert message.strip(), kind
        assert "\n" not in message, message
        assert len(message) < 2000, message
    return result


def fuzzed(few: int, many: int, **strategies: Any) -> Callable[[Callable[..., None]], Any]:
    """Return a decorator that gives a test few inputs in `make test` and many in `make test-slow`, always the same ones."""

    def decorate(test: Callable[..., None]) -> Any:
        def of(number: int) -> Any:
            chosen = settings(
                max_examples=number,
                deadline=None,
                suppress_health_check=list(HealthCheck),
                derandomize=True,
                database=None,
                phases=[Phase.generate],  # an input that fails is shown as it is: a smaller one would take minutes
            )
            return chosen(given(**strategies)(test))

        quick, slow = of(few), of(many)

        def run(how_many: str) -> None:
            (quick if how_many == "few" else slow)()

        run.__name__, run.__doc__ = test.__name__, test.__doc__
        return pytest.mark.parametrize("how_many", ["few", pytest.param("many", marks=pytest.mark.slow)])(run)

    return decorate


SCALARS = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-(2**70), 2**70),
    st.floats(),
    st.sampled_from([0, 1, -1, 0.5, 1e-300, 1e300, 2**63, "", "nan", "1e-3", "auto", "true", "null", "x" * 500]),
    st.text(max_size=20),
)
"""What a configuration file may say by mistake."""
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.one_of(st.lists(inner, max_size=5), st.dictionaries(st.text(max_size=8), inner, max_size=4)),
    max_leaves=8,
)


def mutated(content: bytes) -> st.SearchStrategy[bytes]:
    """Return a strategy of some bytes with a few places changed, cut, repeated or filled."""
    at = st.integers(0, max(len(content) - 1, 0))

    def change(content: bytes, edits: list[tuple[str, int, int, bytes]]) -> bytes:
        for how, start, length, new in edits:
            start = min(start, len(content))
            end = min(start + length, len(content))
            part = content[start:end]
            middle = {"replace": new.ljust(len(part), b"\0")[: len(part)], "cut": b"", "repeat": part * 2, "insert": new + part}
            content = content[:start] + middle[how] + content[end:]
        return content

    edit = st.tuples(st.sampled_from(["replace", "cut", "repeat", "insert"]), at, st.integers(0, 40), st.binary(max_size=16))
    return st.lists(edit, min_size=1, max_size=4).map(lambda edits: change(content, edits))


def replaced(draw: Any, value: Any, new: st.SearchStrategy[Any]) -> Any:
    """Return nested mappings and lists with one place replaced, left out or added."""
    if isinstance(value, dict) and value:
        name = draw(st.sampled_from(sorted(value)))
        what = draw(st.sampled_from(["inside", "inside", "replace", "leave out", "rename"]))
        rest = {key: item for key, item in value.items() if key != name}
        if what == "leave out":
            return rest
        if what == "rename":
            return {**rest, draw(st.text(max_size=10)): value[name]}
        return {**value, name: replaced(draw, value[name], new) if what == "inside" else draw(new)}
    if isinstance(value, list) and value and draw(st.booleans()):
        at = draw(st.integers(0, len(value) - 1))
        return [*value[:at], replaced(draw, value[at], new), *value[at + 1 :]]
    return draw(new)


HEADERS = {"replay": "t,vx,gyro,px,py,theta", "calibrate": "time,v,omega,x,y,odom_theta"}
"""Columns of recorded drives, as two commands call them."""


def table(header: str, rows: int = 60) -> str:
    """Return a recorded drive as a table: 0.2 m/s in a gentle curve."""
    times = [0.1 * k for k in range(rows)]
    cells = [(t, 0.2, 0.1 * math.sin(t), 0.2 * t, 0.001 * t, 0.01 * math.sin(t)) for t in times]
    return "\n".join([header, *(",".join(f"{cell:.5f}" for cell in row) for row in cells)])
