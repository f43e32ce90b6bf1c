"""What satellites bring: ``watch`` and ``replay``, found as their commands are."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from turtlebot_gym.drive import Drive
from turtlebot_gym.entry_points import load_entry_point
from turtlebot_gym_agents.front.defaults import DRIVER
from turtlebot_gym_agents.front.driving import DriveResult

GROUP = "turtlebot_gym.commands"


def watch(*what: Any, html: str | Path | None = None, **options: Any) -> None:
    """Show drives in a browser, as `turtlebot-gym watch`: until it is interrupted, or in a file.

    For example ``watch("bearing", "ppo-nav", html="view.html")``. Needs the extra [view].

    Args:
        *what: Policies, as for `evaluate`, that all drive the same episode; or drives, which `drive` returned.
        html: Write the view to this file instead, which opens without a server; an existing file is replaced.
        **options: The command's: ``env``, ``seed``, ``host``, ``port``, and the environment's.

    Raises:
        ImportError: If the viewer is not installed; the message names the extra.
        ValueError: If an argument is unknown or out of its range, or policies and drives are mixed.
    """
    command = load_entry_point(GROUP, "watch", extra="view")
    drives = [each.record if isinstance(each, DriveResult) else each for each in what if isinstance(each, (Drive, DriveResult))]
    if drives and len(drives) < len(what):
        raise ValueError("watch shows policies or drives, got both: drive the policies, and watch what drive() returns.")
    file = None if html is None else Path(html)
    if drives:
        command(html=file, **options).show(drives, title=", ".join(each.around.label for each in drives))
    else:
        command(policy=what or (DRIVER,), html=file, **options).run()


def replay(*files: str | Path, **options: Any) -> Any:
    """Run a filter over recorded drives with known truth, as `turtlebot-gym replay`. Needs the extra [lab].

    Args:
        *files: Recordings with truth: bags, laser arrays, or tables with named columns.
        **options: The command's: ``filter``, ``noise``, ``measured``, ``seeds``, ``rate``, ...

    Returns:
        The errors and the NEES of each recording, as a result that prints, plots and can be written.

    Raises:
        ImportError: If the lab is not installed; the message names the extra.
        ValueError: If a recording cannot be read, or an argument is unknown or out of its range.
    """
    return load_entry_point(GROUP, "replay", extra="lab")(files=tuple(map(Path, files)), **options).result()
