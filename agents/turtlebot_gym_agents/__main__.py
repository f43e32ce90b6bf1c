"""Entry point of the command line: says what to install if only the robot's part is installed."""

from __future__ import annotations

import atexit
import gc
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from turtlebot_gym import __version__
from turtlebot_gym.extras import installing
from turtlebot_gym_agents.outputs import ending_quietly

THRESHOLDS = 100_000, 10, 10
"""`gc.set_threshold` during a command; by default Python collects after every thousand new objects or so."""


@contextmanager
def _rarely_collecting() -> Iterator[None]:
    """Collect garbage rarely within this block, and not at all when the process ends.

    torch and numba create half a million objects that live as long as the process. Scanning them again and again during their
    import, and once more at exit, takes a third of a short training's time.
    """
    usual = gc.get_threshold()
    gc.set_threshold(*THRESHOLDS)
    atexit.register(gc.freeze)
    try:
        yield
    finally:
        gc.set_threshold(*usual)


@ending_quietly
@_rarely_collecting()
def main(argv: Sequence[str] | None = None) -> int:
    """Run a subcommand, and return the exit status."""
    if [*(sys.argv[1:] if argv is None else argv)] == ["--version"]:
        print(f"turtlebot-gym {__version__}")
        return 0
    try:
        from turtlebot_gym_agents.commands.cli import main as run
    except ModuleNotFoundError as error:
        if str(error.name).startswith("turtlebot_gym"):
            raise
        print(f"turtlebot-gym: {error.name} is missing: {installing('gym')}.", file=sys.stderr)
        return 2
    return run(argv)


if __name__ == "__main__":
    raise SystemExit(main())
