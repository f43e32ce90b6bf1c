"""The help of commands: a first screen with the common flags, and all flags by groups.

``--help`` prints the first screen, ``--help-all`` all flags, ``--help GROUP`` those of a group, and ``--help keys`` the keys of
overrides that are no flags. The texts are the docstrings under the fields of the commands.
"""

from __future__ import annotations

import inspect
import re
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields
from functools import partial
from pathlib import Path
from textwrap import wrap as textwrap
from typing import Any

from turtlebot_gym.config import choose
from turtlebot_gym_agents.commands.fields import Flag, flags_of
from turtlebot_gym_agents.commands.overrides import Overridable, keys_of, phrase

PROGRAM = "turtlebot-gym"
ASKS = ("-h", "--help", "--help-all")
GROUPS = ("", "task", "robot and noise", "learning", "output")
"""Groups in the order of the help; the first one is that of the command itself."""
WIDEST, NARROWEST = 100, 50
"""Bounds of a line's width, characters."""
INDENT = 22
"""Characters before the text of a flag."""
wrap = partial(textwrap, break_on_hyphens=False, break_long_words=False)
_SENTENCE = re.compile(r"(?<=[\w)])\. (?=[A-Z])")


def help_of(commands: Mapping[str, type], words: Sequence[str]) -> str | None:
    """Return the help that the words of a command line ask for; None if they ask for none.

    Raises:
        ValueError: If they ask for a group that the command has not.
    """
    asked = next((at for at, word in enumerate(words) if word in ASKS), None)
    if asked is None:
        return None
    width = max(NARROWEST, min(WIDEST, shutil.get_terminal_size().columns))
    if words[0] not in commands:
        return overview(commands, width)
    name, command, about = words[0], commands[words[0]], words[asked + 1 : asked + 2]
    if words[asked] == "--help-all":
        return screen(name, command, width)
    if about and not about[0].startswith("-"):
        if about[0] == "keys":
            return _keys(name, command, width)
        groups = _by_group(command)
        group = choose("group", about[0], {title.partition(" ")[0]: title for title in groups if title} | {"keys": ""})
        return "\n".join([f"{group}:", *_lines(groups[group], width)])
    return screen(name, command, width, common=getattr(command, "COMMON", ()))


def overview(commands: Mapping[str, type], width: int) -> str:
    """Return the help of the program: its commands, each with its first sentence."""
    lines = [
        f"usage: {PROGRAM} COMMAND [--help] ...",
        "",
        "A TurtleBot that navigates on what a Kalman filter believes.",
        "",
    ]
    for name, command in commands.items():
        lines += _entry(name, _SENTENCE.split(_description(command)[0])[0].removesuffix("."), width, INDENT - 8)
    return "\n".join([*lines, "", f"`{PROGRAM} COMMAND --help` explains a command. --version prints the version."])


def screen(name: str, command: type, width: int, *, common: Sequence[str] = ()) -> str:
    """Return the help of a command.

    Args:
        name: Its name.
        command: Its class.
        width: Width of a line, characters.
        common: The fields to show, each with its first sentence; empty for all, by groups.
    """
    flags, first = flags_of(command), _description(command)
    positional = [flag.word for flag in flags if flag.is_positional]
    keys = ["[KEY=VALUE ...]"] if issubclass(command, Overridable) else []
    lines = [f"usage: {PROGRAM} {' '.join([name, *positional, *keys, '[--FLAG VALUE ...]'])}", ""]
    if not common:
        for paragraph in first:
            lines += [*wrap(paragraph, width), ""]
        for title, members in _by_group(command).items():
            lines += [f"{title or 'options'}:", *_lines(members, width), ""]
        return "\n".join([*lines, *_about_keys(name, command, width)]).rstrip()
    lines += [*wrap(first[0], width), ""]
    shown = {flag.path[0]: flag for flag in flags}
    for field in common:
        flag = shown[field]
        lines += _entry(_words(flag), _short(flag), width)
    titles = [title.partition(" ")[0] for title in _by_group(command) if title]
    lines += ["", *_about_keys(name, command, width)]
    return "\n".join([*lines, f"All flags: --help-all; those of a group: --help {'|'.join(titles)}"])


def _about_keys(name: str, command: type, width: int) -> list[str]:
    """Return how to give overrides."""
    if not issubclass(command, Overridable):
        return []
    sets = (
        "a flag, a field of what it names, or a hyper-parameter" if _learns(command) else "a flag, or a field of what it names"
    )
    example = getattr(command, "EXAMPLE", "noise.odometry.spike=0.1")
    return wrap(f"KEY=VALUE sets {sets}: {example}. All keys: --help keys", width)


def _learns(command: type) -> bool:
    return "overrides" in {item.name for item in fields(command)}


def _keys(name: str, command: type, width: int) -> str:
    """Return the keys of overrides that are no flags, each with its text."""
    flags = {flag.key for flag in flags_of(command)}
    keys = {key: text for key, text in keys_of(command).items() if key not in flags}
    if not keys:
        raise ValueError(f"{name} takes no keys: see its flags, {PROGRAM} {name} --help-all.")
    lines = ["Keys beside the flags, KEY=VALUE:", ""]
    for key, text in keys.items():
        lines += _entry(key, text, width, INDENT + 14)
    if _learns(command):
        from turtlebot_gym_agents.training.arguments import ALGORITHMS, names_of

        lines += ["", "Hyper-parameters, which Stable-Baselines3 documents:", ""]
        for algo in ALGORITHMS:
            lines += _entry(algo, ", ".join(names_of(algo)), width)
    return "\n".join(lines)


def _description(command: type) -> list[str]:
    """Return the paragraphs of a command's docstring."""
    return [" ".join(part.split()) for part in (inspect.getdoc(command) or "").split("\n\n")]


def _by_group(command: type) -> dict[str, list[Flag]]:
    flags = flags_of(command)
    ordered = sorted({flag.group for flag in flags}, key=GROUPS.index)
    return {title: [flag for flag in flags if flag.group == title] for title in ordered}


def _lines(flags: Sequence[Flag], width: int) -> list[str]:
    return [line for flag in flags for line in _entry(_words(flag), f"{flag.text}{_default(flag)}", width)]


def _words(flag: Flag) -> str:
    """Return a flag with what stands for its value."""
    if flag.kind is bool and flag.default is True:
        return f"--no-{flag.word[2:]}"
    return flag.word if flag.is_positional or not flag.metavar else f"{flag.word} {flag.metavar}"


def _short(flag: Flag) -> str:
    """Return the first sentence of a flag's text, with the default."""
    return f"{_SENTENCE.split(flag.text)[0].removesuffix('.')}.{_default(flag)}".replace("..", ".")


def _default(flag: Flag) -> str:
    value: Any = flag.default
    if value is MISSING or value is None or isinstance(value, bool) or value in ((), ""):
        return ""
    shown = " ".join(map(str, value)) if isinstance(value, tuple) else str(value) if isinstance(value, Path) else phrase(value)
    return f" (default {shown})"


def _entry(word: str, text: str, width: int, indent: int = INDENT) -> list[str]:
    """Return the lines of an entry: its word, and its text beside it, or below if the word is long."""
    lines = wrap(text, width - indent) or [""]
    if len(word) + 4 > indent:
        return [f"  {word}", *(" " * indent + line for line in lines)]
    return [f"  {word:<{indent - 2}}{lines[0]}".rstrip(), *(" " * indent + line for line in lines[1:])]
