"""What satellites bring: their commands, and ``watch`` and ``replay`` in Python; each is imported when it is used."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

from turtlebot_gym.drive import Drive
from turtlebot_gym_agents.evaluation.evaluate import policy_of
from turtlebot_gym_agents.front.driving import DriveResult

SATELLITES = {
    "calibrate": "turtlebot_gym_lab.commands.calibrate",
    "replay": "turtlebot_gym_lab.commands.replay",
    "watch": "turtlebot_gym_view.command",
}
"""Module of each command."""


def satellite(name: str, attribute: str = "") -> Callable[..., Any]:
    """Return a command of a satellite, or another function beside it.

    Raises:
        ImportError: If what the satellite needs is not installed; the message says what to install.
    """
    try:
        return getattr(import_module(SATELLITES[name]), attribute or name)
    except ImportError as error:
        raise ImportError(f"{name} needs the extra [agents]: pip install 'turtlebot-gym[agents]' ({error}).") from error


def watch(*what: Any, html: str | Path | None = None, **options: Any) -> Any:
    """Return the view of drives, as `turtlebot-gym watch` shows it. Needs the extra [agents].

    For example ``watch("bearing", "ppo-nav", html="view.html")``. A notebook shows what is returned, and
    ``save("view.html")`` writes a file.

    Args:
        *what: Policies, as for `evaluate`, that all drive the same episode; or drives, which `drive` returned.
        html: Also write the view to this file, which opens in any browser; an existing file is replaced.
        **options: For policies: ``env``, ``seed``, ``allow_mismatch``, and the environment's.

    Raises:
        ImportError: If Bokeh is not installed; the message says what to install.
        ValueError: If an argument is unknown or out of its range, or policies and drives are mixed.
    """
    drives = [each.record if isinstance(each, DriveResult) else each for each in what if isinstance(each, (Drive, DriveResult))]
    if drives and len(drives) < len(what):
        raise ValueError("watch shows policies or drives, got both: drive the policies, and watch what drive() returns.")
    if drives:
        page = satellite("watch", "page_of")(drives, title=", ".join(each.around.label for each in drives))
    else:
        policies = tuple(each if isinstance(each, str) else policy_of(each) for each in what) or ("bearing",)
        page = satellite("watch", "episodes")(policies, **{"env": None, "seed": 0, **options})
    if html is not None:
        page.save(Path(html))
    return page


def replay(*files: str | Path, **options: Any) -> Any:
    """Run a filter over recorded drives with known truth, as `turtlebot-gym replay`, and return errors and NEES of each.

    The files are bags, laser arrays, or tables with named columns; the options are the command's: ``filter``, ``noise``,
    ``measured``, ``seeds``, ``rate``, ... It needs the extra [agents].
    """
    return satellite("replay")(*map(Path, files), **options)
