"""The subcommand ``watch``."""

from __future__ import annotations

import tempfile
import webbrowser
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from turtlebot_gym_agents.commands.console import WritingOptions, needs
from turtlebot_gym_agents.evaluation.result import title_of
from turtlebot_gym_agents.flags import EnvironmentOptions
from turtlebot_gym_agents.ids import environment_id
from turtlebot_gym_agents.outputs import OutputFile
from turtlebot_gym_lab.commands.recorded import MountOption

if TYPE_CHECKING:
    from turtlebot_gym.drive import Drive
    from turtlebot_gym_view.page import Page


@dataclass(frozen=True, kw_only=True)
class Watch(WritingOptions, MountOption):
    """Show drives in a browser: an episode of each policy, or recorded drives. Play, select times, compare.

    Needs the extra [view].
    """

    policy: tuple[str, ...] = ("bearing",)
    """Policies as for evaluate, at most six; all drive the same episode."""
    env: str = "nav"
    """Environment: nav, pose, square, rooms, missions, or the id of another one."""
    seed: int = 0
    """Seed of the episode."""
    allow_mismatch: bool = False
    """Also drive policies made for another task, observation, robot or rate."""
    options: Annotated[EnvironmentOptions, tyro.conf.OmitArgPrefixes] = field(default_factory=dict)
    """Options of the environment."""
    drive: tuple[Path, ...] = ()
    """Recorded drives instead of episodes, as calibrate and replay take them."""
    html: Annotated[Path | None, tyro.conf.arg(metavar="FILE.html"), OutputFile((".html", ".htm"))] = None
    """Write the view to this file, which opens without a network; by default a browser shows a temporary one."""
    side_by_side: bool = False
    """Give each drive a map of its own; else drives in the same room are drawn over each other."""

    def run(self) -> None:
        page = self.page()
        path = self.html or Path(tempfile.mkdtemp(prefix="watch-")) / "drives.html"
        print(f"{path}: {page.save(path):,} bytes; open it in a browser.")
        if self.html is None:
            webbrowser.open(path.as_uri())

    def page(self) -> Page:
        """Drive the episodes, or read the recordings, and return their page, which a notebook shows.

        Raises:
            ValueError: If an argument is unknown or out of its range, or a policy cannot drive; nothing is driven then.
        """
        if self.drive and set(self.options) - {"lidar"}:
            raise ValueError(f"{', '.join(self.options)} would change nothing in recorded drives: leave out it, or --drive.")
        from turtlebot_gym_view import read_recorded, record_episode

        with needs("view"):
            from turtlebot_gym_view.view import require_number
        number = len(self.drive or self.policy)
        require_number(number)
        if self.side_by_side and number == 1:
            raise ValueError("--side-by-side needs two drives or more: add a policy or a recording, or leave it out.")
        if self.drive:
            drives = [read_recorded(path, lidar=self.options.get("lidar", "lds01"), **self.reading()) for path in self.drive]
            title = f"Recorded: {', '.join(path.name for path in self.drive)}"
        else:
            given = {"env": environment_id(self.env), "seed": self.seed, **self.options}
            require_drivers(self.policy, allow_mismatch=self.allow_mismatch, **given)
            drives = [record_episode(policy, allow_mismatch=self.allow_mismatch, **given) for policy in self.policy]
            title = title_of(given)
        return self.page_of(drives, title=title)

    def page_of(self, drives: Sequence[Drive], *, title: str) -> Page:
        """Return the page of drives that others have driven."""
        with needs("view"):
            from turtlebot_gym_view.page import Page
        return Page(drives=drives, title=title, side_by_side=self.side_by_side)


def require_drivers(policies: Sequence[str], *, env: str, seed: int, allow_mismatch: bool = False, **options: Any) -> None:
    """Refuse policies of which one cannot drive an environment: each drives a step.

    Raises:
        ValueError: If an argument is unknown or out of its range, or a policy does not match the environment.
    """
    from turtlebot_gym_agents.evaluation.driving import driven
    from turtlebot_gym_agents.evaluation.evaluate import driver_of, make_envs, require_known

    require_known(env, seed)
    envs = make_envs(env, 1, **options)
    try:
        for policy in policies if len(policies) > 1 else ():  # the only one is refused as early by its drive
            steps = driven(envs, driver_of(policy, envs, allow_mismatch=allow_mismatch), seed=seed, episodes=1)
            next(steps)
            next(steps)
    finally:
        envs.close()
