"""Objects of a user's own, named "module:name": errors in their code are reported with file and line."""

from __future__ import annotations

import os
import sys
import traceback
from importlib import import_module
from types import ModuleType
from typing import Any


def load_object(name: str) -> Any:
    """Import an object.

    Args:
        name: "module:name"; the module is searched for as by ``import``, and last in the working folder, where programs that
            pip or ROS installs do not look. Python's option ``-P`` leaves that folder out.

    Raises:
        ValueError: If there is no such module, importing it fails, or it has no such name; the message is one line.
    """
    module, _, attribute = name.partition(":")
    if not (module and attribute):
        raise ValueError(f"{name!r} must be 'module:name'.")
    if module.endswith(".py") or not all(map(str.isidentifier, module.split("."))):
        raise ValueError(f"{name!r} must be 'module:name' of a Python module, without folders and .py, such as mine:drive.")
    found = _import(name, module)
    try:
        return getattr(found, attribute)
    except AttributeError:
        where = f" ({found.__file__})" if getattr(found, "__file__", None) else ""
        raise ValueError(f"module {module!r}{where} has no attribute {attribute!r}.") from None


def source_of(value: Any, *modules: str) -> str:
    """Return "module:name", by which `load_object` finds an object; empty if it is at the top level of none of some modules.

    Args:
        value: The object; one that equals it will do.
        *modules: Names of imported modules to search, in order; ``__main__`` is a notebook's or a script's.
    """
    for module in modules:
        for name, other in [*vars(sys.modules[module]).items()] if module in sys.modules else ():
            if type(other) is type(value) and other == value:
                return f"{module}:{name}"
    return ""


def _import(name: str, module: str) -> ModuleType:
    """Import a module of a user's own."""
    here = os.getcwd()
    if not getattr(sys.flags, "safe_path", False) and not {here, ""} & {*sys.path}:
        sys.path.append(here)
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        if not f"{module}.".startswith(f"{error.name}."):
            raise failure(name, error) from error  # an import inside of the module
        package = sys.modules.get(str(error.name).rpartition(".")[0])
        if package:
            why = f"{package.__name__!r} is {package.__file__}."
        else:
            where = f"not even in {here}" if {here, ""} & {*sys.path} else "where the option -P leaves out the working folder"
            why = f"{where}: start the program in the module's folder, or set PYTHONPATH=FOLDER."
        raise ValueError(f"No module named {error.name!r}, {why}") from error
    except (Exception, SystemExit) as error:
        raise failure(name, error) from error


def failure(name: str, error: BaseException) -> ValueError:
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
