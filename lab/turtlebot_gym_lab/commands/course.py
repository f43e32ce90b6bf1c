"""The subcommand ``check``: it hands out an exercise, and reports which parts of a solution are right."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from runpy import run_path
from typing import Annotated, Any

import tyro

from turtlebot_gym.files import write_text
from turtlebot_gym.plugins import failure
from turtlebot_gym.validation import short_repr

NUMBERS = (1, 2, 3, 4)
EXERCISES = tuple(f"exercise{number}.py" for number in NUMBERS)
WRITTEN = f"{EXERCISES[0]} to {EXERCISES[-1]} are written where they are missing."


@dataclass(frozen=True, kw_only=True)
class Check:
    """Check the solution of an exercise; a missing exercise is written, with its gaps.

    The exit status is 1 while something is not yet right.
    """

    file: tyro.conf.Positional[Annotated[Path | None, tyro.conf.arg(metavar="FILE.py")]] = None
    """Your solution; its code is run. Where exercise1.py to exercise4.py are missing, they are written."""

    def run(self) -> None:
        if self.file is None:
            raise ValueError(f"name the FILE.py to check; {WRITTEN}")
        if self.file.name in EXERCISES and not self.file.exists():
            text = resources.files("turtlebot_gym_lab.course").joinpath(self.file.name).read_text(encoding="utf-8")
            write_text(self.file, text)
            print(f"{self.file} was not there: it is written. Fill in its gaps, and check it again.")
        names = _names_of(self.file)
        right = 0
        from turtlebot_gym_lab.course.checks import CHECKS

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
        ValueError: If it fails, or is not a solution of an exercise.
    """
    if not path.is_file():
        raise ValueError(f"There is no file {str(path)!r}; {WRITTEN}")
    try:
        names = run_path(str(path))
    except Exception as error:
        raise failure(str(path), error) from error
    number = names.get("EXERCISE")
    if number not in NUMBERS:
        raise ValueError(f"{path}: EXERCISE must be one of {', '.join(map(str, NUMBERS))}, got {short_repr(number)}.")
    return names
