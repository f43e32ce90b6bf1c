"""The command line, ``turtlebot-gym``: the functions of this package, each of whose arguments is a flag.

To add a command, write a function with types and a docstring, and name it in `COMMANDS`, or in `satellites`. What a function
returns is printed; progress and errors go to standard error.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import tyro

from turtlebot_gym_agents.cluster.study import study
from turtlebot_gym_agents.front.comparing import compare
from turtlebot_gym_agents.front.learning import train
from turtlebot_gym_agents.front.satellites import SATELLITES, satellite
from turtlebot_gym_agents.training.export import export

COMMANDS: dict[str, Callable[..., Any]] = {"evaluate": compare, "train": train, "export": export, "study": study}
"""The product's commands; `commands` adds those of satellites."""


def commands() -> dict[str, Callable[..., Any]]:
    """Return all commands by name; those of a satellite that is not installed are left out."""
    found = dict(COMMANDS)
    for name in SATELLITES:
        with suppress(ImportError):
            found[name] = satellite(name)
    return found


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command and return the exit status: 0, or 2 with one line of explanation if the request is invalid."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")  # pyright: ignore[reportAttributeAccessIssue]  # no result is lost at the end
    if (here := str(Path.cwd())) not in sys.path:
        sys.path.append(here)  # for users' policies, which a console script would not find
    with warnings.catch_warnings():
        warnings.showwarning = lambda message, *where, **more: print(f"turtlebot-gym: {message}", file=sys.stderr)
        try:
            made = tyro.extras.subcommand_cli_from_dict(commands(), prog="turtlebot-gym", args=argv)
            if made is not None:
                print(made)
        except BrokenPipeError:
            raise  # see `process.ending_quietly`
        except MemoryError:
            print("turtlebot-gym: there is not enough memory for this request.", file=sys.stderr)
            return 2
        except (ValueError, TypeError, OSError, ImportError) as error:
            print(f"turtlebot-gym: {' '.join(str(error).split())}", file=sys.stderr)
            return 2
        except KeyboardInterrupt:
            print("turtlebot-gym: interrupted.", file=sys.stderr)
            return 130
    return 0
