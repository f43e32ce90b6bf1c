"""The command line of programs that are no nodes, in one style with the help of the nodes."""

from __future__ import annotations

import argparse
import shutil

from cmd_vel_guard.explain import WIDTH

COLUMN = 28
"""Longest option that stands on one line with its text, characters."""


class _Formatter(argparse.HelpFormatter):
    """As wide as the terminal, also where that is wide."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, max_help_position=COLUMN, width=shutil.get_terminal_size((WIDTH, 24)).columns)


def parser_of(name: str, description: str) -> argparse.ArgumentParser:
    """Return the parser of ``python -m turtlebot_gym_ros NAME``."""
    return argparse.ArgumentParser(
        prog=f"python -m turtlebot_gym_ros {name}", description=description, formatter_class=_Formatter
    )
