"""The subcommand ``check``: it gives out an exercise, and says what of a solution is right and what is not yet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from runpy import run_path
from typing import Annotated, Any

import tyro

from turtlebot_gym.own import failure
from turtlebot_gym.validation import refusal, shown

NUMBERS = (1, 2, 3, 4)


@dataclass(frozen=True, kw_only=True)
class Check:
    """Check the solution of an exercise, or write one to fill in. The exit status is 1 while something is not yet right."""

    file: tyro.conf.Positional[Annotated[Path | None, tyro.conf.arg(metavar="FILE.py")]] = None
    """Your solution; its code is run."""
    write: int | None = None
    """Write exercise 1, 2, 3 or 4 with its gaps to exerciseN.py instead."""

    def run(self) -> None:
        if self.write is not None:
            _write(self.write)
            return
        if self.file is None:
            raise ValueError("name the FILE.py to check, or write one to fill in by --write 1.")
        names = _names_of(self.file)
        right = 0
        from turtlebot_gym_agents.course.checks import CHECKS

        checks = CHECKS[names["EXERCISE"]]
        for text, check in checks:
            try:
                hint = check(names)
            except NotImplementedError:
                hint = "It is still a gap."
            except KeyError as error:
                hint = f"There is no {error} in the file."
            except Exception as error:
                hint = str(failure(str(self.file), error))
            print(f"  {'not yet' if hint else 'right  '}  {text}{f' {hint}' if hint else ''}", flush=True)
            right += not hint
        print(f"{right} of {len(checks)} are right.")
        if right < len(checks):
            raise SystemExit(1)


def _names_of(path: Path) -> Mapping[str, Any]:
    """Run a solution and return its names.

    Raises:
        ValueError: If it fails, or is no solution of an exercise.
    """
    if not path.is_file():
        raise ValueError(f"There is no file {str(path)!r}.")
    try:
        names = run_path(str(path))
    except Exception as error:
        raise failure(str(path), error) from error
    number = names.get("EXERCISE")
    if number not in NUMBERS:
        raise ValueError(f"{path}: EXERCISE must be one of {', '.join(map(str, NUMBERS))}, got {shown(number)}.")
    return names


def _write(number: int) -> None:
    if number not in NUMBERS:
        raise refusal("write", f"one of {', '.join(map(str, NUMBERS))}", number)
    path = Path(f"exercise{number}.py")
    text = resources.files("turtlebot_gym_agents.course").joinpath(path.name).read_text(encoding="utf-8")
    if path.exists():
        raise ValueError(f"{path} exists already.")
    path.write_text(text, encoding="utf-8")
    print(f"{path}: fill it in, then: turtlebot-gym check {path}")
