"""Objects of a user's own, named "module:name": errors in their code are reported with file and line."""

from __future__ import annotations

import traceback
from importlib import import_module
from typing import Any


def load_object(name: str) -> Any:
    """Import an object.

    Args:
        name: "module:name"; the module is searched for as by ``import``.

    Raises:
        ValueError: If the name is unknown, or importing its module fails; the message is one line.
    """
    module, _, attribute = name.partition(":")
    if not (module and attribute):
        raise ValueError(f"{name!r} must be 'module:name'.")
    try:
        return getattr(import_module(module), attribute)
    except (ModuleNotFoundError, AttributeError) as error:
        raise ValueError(f"{error}.") from error
    except Exception as error:
        raise failure(name, error) from error


def failure(name: str, error: Exception) -> ValueError:
    """Return an error in a user's code as one line, with its place.

    Args:
        name: "module:name" of what failed.
        error: The error, as it was caught.
    """
    if isinstance(error, SyntaxError):
        return ValueError(f"{name}: SyntaxError: {error.msg} ({error.filename}, line {error.lineno}).")
    frames = traceback.extract_tb(error.__traceback__)[1:]  # without the caller's own
    theirs = [frame for frame in frames if "importlib" not in frame.filename and "site-packages" not in frame.filename]
    place = (theirs or frames or traceback.extract_tb(error.__traceback__))[-1]
    text = " ".join(str(error).split())
    return ValueError(f"{name}: {type(error).__name__}: {text} ({place.filename}, line {place.lineno}).")
