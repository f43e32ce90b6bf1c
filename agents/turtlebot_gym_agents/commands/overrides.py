"""Overrides: words KEY=VALUE beside the flags of a command.

A key is the name of a flag, ``noise=wheel``; a field of what a flag names, ``noise.odometry.spike=0.1``; a field of the
environment's task, ``task.radius=0.3``; a term of the reward, ``reward.effort=0.2``; or, where something is trained, a
hyper-parameter, ``learning_rate=3e-4``. The keys are the fields of the dataclasses.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Annotated, Any, TypeVar, get_origin, get_type_hints

import tyro

from turtlebot_gym.config import BASE, did_you_mean, flattened, short_repr
from turtlebot_gym_agents.commands.fields import Flag, flags_of, texts_of
from turtlebot_gym_agents.commands.typed import free, typed

_WORD = re.compile(r"([A-Za-z_][\w.:-]*)=(.*)", re.DOTALL)
_ALIASES = {"tuning": "filter"}
"""Other names of keys: the parameters of an environment call its filter ``tuning``."""
_NEEDED = {"fix": "beacons", "imu": "calibrated", "localizer": "match"}
"""Options that are off by default, each with an example: without it there is nothing to change."""

Hidden = Annotated[Mapping[str, Any], tyro.conf.Fixed, tyro.conf.Suppress]
"""Type of a field of a command that is no flag."""


@dataclass(frozen=True, kw_only=True)
class Overridable:
    """A command with an environment, ``env``, that takes overrides."""

    changes: Hidden = field(default_factory=dict)
    """Changed fields of options, by option: ``{"noise": {"odometry": {"spike": 0.1}}}``."""

    def varied(self, options: Mapping[str, Any]) -> dict[str, Any]:
        """Return keyword arguments of an environment, with each changed option as a variant of what is chosen."""
        result = dict(options)
        for name, changes in self.changes.items():
            if (chosen := result.get(name)) is None:
                from turtlebot_gym_agents.training.config import base_of

                chosen = base_of(self.env, name)  # pyright: ignore[reportAttributeAccessIssue]
            if chosen is None and name in _NEEDED:
                first = next(flattened({name: changes}))[0]
                raise ValueError(f"{first} changes a {name}, and there is none: add one, such as {name}={_NEEDED[name]}.")
            result[name] = self.variant(name, chosen)
        return result

    def variant(self, name: str, chosen: Any) -> Any:
        """Return a value of an option as a variant with the fields that are changed; as it is without any."""
        changes = self.changes.get(name)
        return {BASE: chosen, **changes} if changes else chosen

    def changed(self) -> list[str]:
        """Return the overrides that no flag stands for, each as a phrase of a table's header."""
        return [f"{key} {phrase(value)}" for key, value in flattened(self.changes)]

    def take(self, name: str, unknown: Mapping[str, Any]) -> dict[str, Any]:
        """Return the fields that keys set which are neither flags nor fields of options; here there are none.

        Args:
            name: The command's name.
            unknown: The values by key, at least one.
        """
        from turtlebot_gym_agents.training.hyperparameters import shipped_names

        for key in unknown:
            if key.partition(".")[0] in shipped_names():
                raise ValueError(f"{key} is a hyper-parameter, and {name} trains nothing: leave it out.")
        raise unknown_key(type(self), name, next(iter(unknown)))


C = TypeVar("C", bound=Overridable)


def extract(command: type, words: Sequence[str]) -> tuple[list[str], list[tuple[str, str]]]:
    """Return the words of a command without its overrides, and these as keys and values.

    The word after a flag is the flag's, even if it has the form KEY=VALUE, and then so are those of this form that follow it.
    """
    if not issubclass(command, Overridable):
        return list(words), []
    switches = {word for flag in flags_of(command) if flag.kind is bool for word in (flag.word, f"--no-{flag.word[2:]}")}
    kept, pairs, is_first, is_owned = list[str](), list[tuple[str, str]](), False, False
    for word in words:
        match = _WORD.fullmatch(word)
        if word.startswith("--"):
            is_first, is_owned = "=" not in word and word.replace("_", "-") not in switches, False
        elif match and not (is_first or is_owned):
            pairs.append((match[1], match[2]))
            continue
        else:
            is_first, is_owned = False, is_owned or (is_first and match is not None)
        kept.append(word)
    return kept, pairs


def override(command: C, name: str, pairs: Sequence[tuple[str, str]], words: Sequence[str]) -> C:
    """Return a command with overrides.

    Args:
        command: The command with its flags.
        name: Its name.
        pairs: The overrides, keys and values, by `extract`.
        words: The command's other words, which tell what flags are given.

    Raises:
        ValueError: If a key is unknown, a value is of another type, or two values of one key differ.
    """
    flags = {flag.key: flag for flag in flags_of(type(command))}
    given = {word.partition("=")[0].replace("_", "-") for word in words}
    options = parts_of(type(command)) if pairs else {}
    values, changes, unknown = dict[str, Any](), dict[str, Any](), dict[str, Any]()
    for key, text in pairs:
        top, *path = _path(key)
        flag = flags.get(".".join([top, *path]))
        if flag:
            value = typed(key, flag.kind, text)
            _put(values, flag.path, key, value, _value(command, flag) if flag.word in given else value)
        elif path and top == "reward" and top in flags:
            weight, before = typed(key, float, text), command.reward or {}  # pyright: ignore[reportAttributeAccessIssue]
            _put(values, (top, *path), key, weight, before.get(path[0], weight))
        elif path and top in options and path[0] != BASE:  # which the option itself names
            for inner, value in _leaves(path, free(key, text)):
                _put(changes, (top, *inner), key, value, value)
        elif top == "task" and top in options:
            raise ValueError("task is that of the environment: choose another one, such as env=pose.")
        else:
            _put(unknown, (".".join([top, *path]),), key, value := free(key, text), value)
    more = command.take(name, unknown) if unknown else {}
    return replace(command, **_nested(command, values), **({"changes": changes} if changes else {}), **more)


def parts_of(command: type) -> dict[str, type]:
    """Return the options of environments whose fields a command can change, each with the class of its parameters."""
    if not issubclass(command, Overridable):
        return {}
    from turtlebot_gym import Options

    hints = get_type_hints(Options)
    found = {item.name: _parameters_in(hints[item.name]) for item in fields(Options)}
    return {name: kind for name, kind in found.items() if kind is not None}


def keys_of(command: type) -> dict[str, str]:
    """Return the keys of overrides that a command takes, hyper-parameters apart, each with the text under its field."""
    keys = {flag.key: flag.text for flag in flags_of(command) if not flag.is_positional}
    for name, kind in parts_of(command).items():
        keys |= _keys_in(kind, f"{name}.")
    return keys


def unknown_key(command: type, name: str, key: str, more: Sequence[str] = ()) -> ValueError:
    """Return the error for a key that a command does not know, which asks whether a similar one was meant."""
    known = [*keys_of(command), *more]
    meant = did_you_mean(key, known)
    return ValueError(f"{name} has no {short_repr(key)}; `turtlebot-gym {name} --help keys` lists what it has.{meant}")


def phrase(value: Any) -> str:
    """Return a value as a phrase of a table's header."""
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(phrase, value))}]"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _path(key: str) -> list[str]:
    top, *path = key.split(".")
    top = _ALIASES.get(top, top).replace("-", "_")
    return [top, ".".join(path)] if top == "reward" and path else [top, *path]  # a term is MODULE:NAME, with dots


def _value(command: Any, flag: Flag) -> Any:
    for name in flag.path:
        command = getattr(command, name)
    return command


def _nested(owner: Any, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return new values of fields, of which some are given for the fields or the entries within."""
    made = {}
    for name, value in values.items():
        before = getattr(owner, name)
        if isinstance(value, Mapping) and is_dataclass(before):
            made[name] = replace(before, **_nested(before, value))  # pyright: ignore[reportArgumentType]
        else:
            made[name] = {**(before or {}), **value} if isinstance(value, Mapping) else value
    return made


def _leaves(path: list[str], value: Any) -> Iterator[tuple[list[str], Any]]:
    if isinstance(value, Mapping):
        for key, part in value.items():
            yield from _leaves([*path, str(key)], part)
    else:
        yield path, value


def _put(place: dict[str, Any], path: Sequence[str], key: str, value: Any, before: Any) -> None:
    """Put a value into nested mappings, unless it differs from the one that is there, or was given otherwise before."""
    for part in path[:-1]:
        place = place.setdefault(part, {})
        if not isinstance(place, dict):
            raise ValueError(f"{key} and all of {part} are given: leave out one of them.")
    before = place.get(path[-1], before)
    if before != value:
        raise ValueError(f"{key} is given twice, as {short_repr(before)} and {short_repr(value)}: leave out one of them.")
    place[path[-1]] = value


def _parameters_in(hint: Any) -> type | None:
    """Return the class of parameters among the types of an option that may be a mapping of some of its fields."""
    kinds = (hint, *getattr(hint, "__args__", ()))
    if not any(get_origin(kind) is Mapping for kind in kinds):
        return None
    return next((kind for kind in kinds if isinstance(kind, type) and is_dataclass(kind)), None)


def _keys_in(kind: type, prefix: str) -> dict[str, str]:
    from turtlebot_gym.parameters import KINDS, FilterTuning

    hints, texts, keys = get_type_hints(kind), texts_of(kind), dict[str, str]()
    for item in fields(kind):
        inner: Any = hints[item.name]
        if kind is FilterTuning and item.name == "kind":
            keys[f"{prefix}kind.name"] = texts["kind"]
            for one in KINDS.values():
                keys |= _keys_in(one, f"{prefix}kind.")
        elif isinstance(inner, type) and is_dataclass(inner):
            keys |= _keys_in(inner, f"{prefix}{item.name}.")
        else:
            keys[f"{prefix}{item.name}"] = texts.get(item.name, "")
    return keys
