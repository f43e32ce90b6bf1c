"""The text under ``policy_kwargs`` in the files of rl-baselines3-zoo.

The zoo passes ``policy_kwargs`` to Python's ``eval`` where it is text, and as it is to the algorithm where it is a mapping; a
mapping cannot name an activation function. So the files hold ``policy_kwargs: dict(net_arch=[64, 64], activation_fn=nn.ReLU)``.
Here that text is parsed, and refused if it is anything but a call of ``dict`` with literals and names of ``nn``.

References:
    rl-baselines3-zoo 2.9.2, ``rl_zoo3/exp_manager.py``, ``_preprocess_hyperparams``.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from turtlebot_gym.validation import refusal


def write_keywords(keywords: Mapping[str, Any]) -> str:
    """Return text that `read_keywords` reads back, and that the zoo evaluates to the same."""
    written = (f"{key}={f'nn.{value}' if key == 'activation_fn' else repr(value)}" for key, value in keywords.items())
    return f"dict({', '.join(written)})"


def read_keywords(text: str) -> dict[str, Any]:
    """Return what ``dict(name=literal, activation_fn=nn.Name)`` says, with the name as text, without running it.

    Raises:
        ValueError: If the text is anything else.
    """
    with suppress(SyntaxError, ValueError, RecursionError):
        call = ast.parse(text.strip(), mode="eval").body
        if isinstance(call, ast.Call):
            return _value(call)
    allowed = "a mapping, or text like 'dict(net_arch=[64, 64], activation_fn=nn.ReLU)'"
    raise refusal("policy_kwargs", allowed, text)


def _value(node: ast.expr) -> Any:
    match node:
        case ast.Call(func=ast.Name(id="dict"), args=[], keywords=keywords) if all(keyword.arg for keyword in keywords):
            return {str(keyword.arg): _value(keyword.value) for keyword in keywords}
        case ast.Attribute(value=ast.Name(id="nn"), attr=name):
            return name
    return ast.literal_eval(node)
