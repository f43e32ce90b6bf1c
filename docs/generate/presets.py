"""The presets' page: every robot, noise and filter that has a name, with its numbers and with the comment on its source."""

from dataclasses import fields, is_dataclass

import griffe
import mkdocs_gen_files

from turtlebot_gym import presets
from turtlebot_gym.robots import ROBOTS, Robot

code = griffe.load("turtlebot_gym")


def said(path):
    """Return a docstring of the package, on one line."""
    return " ".join(code[path].docstring.value.split())


def number(value):
    """Return a value as a reader wants it."""
    if isinstance(value, tuple):
        return "(" + ", ".join(map(number, value)) + ")"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def differences(value, path=""):
    """Yield the fields of a parameter class that are not at their defaults, as ``name = value``."""
    for field in fields(value):
        part = getattr(value, field.name)
        if is_dataclass(part):
            yield from differences(part, f"{path}{field.name}.")
        elif part != field.default:
            yield f"`{path}{field.name} = {number(part)}`"


with mkdocs_gen_files.open("reference/presets.md", "w") as page:

    def table(*columns):
        """Begin a table."""
        print(f"\n| {' | '.join(columns)} |\n{'|---' * len(columns)}|", file=page)

    print(
        "# Presets\n\nWherever a preset's name is accepted, so are [parameters of your own](../howto/robot.md).\n\n## Robots",
        file=page,
    )
    table("", *ROBOTS)
    for field in fields(Robot):
        row = " | ".join(number(getattr(robot, field.name)) for robot in ROBOTS.values())
        print(f"| `{field.name}`: {said(f'robots.Robot.{field.name}')} | {row} |", file=page)
    print("\n## Noise\n\nFields not listed keep their defaults, which mean no noise.", file=page)
    table("name", "what it is", "parameters")
    for name, noise in presets.NOISES.items():
        print(f"| `{name}` | {said(f'presets.{name.upper()}')} | {', '.join(differences(noise))} |", file=page)
    print("\n## Fixes\n", said("presets.FIXES"), file=page)
    table("name", "parameters")
    for name, fix in presets.FIXES.items():
        print(f"| `{name}` | {', '.join(differences(fix))} |", file=page)
    print("\n## Filters\n\nFilters by name follow from the noise in force.\n", file=page)
    for name in ("matched", "gated", "gyro"):
        print(f"`{name}`: {said(f'presets.{presets.FILTERS[name].__name__}').removeprefix('Return the ')}\n", file=page)
    print(f"`tutorial`: {said('presets.TUTORIAL_FILTER')}", file=page)
