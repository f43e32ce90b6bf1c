"""The subcommand ``watch``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from turtlebot_gym_agents.commands.console import DriveOptions, WritingOptions, needs
from turtlebot_gym_agents.ids import environment_id
from turtlebot_gym_agents.outputs import OutputFile
from turtlebot_gym_lab.commands.recorded import MountOption

if TYPE_CHECKING:
    from turtlebot_gym.drive import Drive


@dataclass(frozen=True, kw_only=True)
class Watch(WritingOptions, MountOption, DriveOptions):
    """Show drives in a browser: an episode of each policy, side by side, or recorded drives. Play, pause, scrub.

    The live ROS graph is shown by "python -m turtlebot_gym_ros watch". Needs the extra [view].
    """

    policy: tuple[str, ...] = ("bearing",)
    """Policies as for evaluate; all drive the same episode."""
    seed: int = 0
    """Seed of the episode."""
    drive: tuple[Path, ...] = ()
    """Recorded drives instead of episodes, as calibrate and replay take them, or snapshots.csv of data_logger."""
    html: Annotated[Path | None, tyro.conf.arg(metavar="FILE.html"), OutputFile((".html", ".htm"))] = None
    """Write the view to this file, which opens without a server or a network, instead of serving it."""
    host: str = "localhost"
    """Name or address to listen on; with 0.0.0.0 anyone who can reach this machine sees the view."""
    port: int = 5006
    """Port to listen on; 0 for any that is free."""

    def run(self) -> None:
        from turtlebot_gym_view import read_recorded, record_episode

        with needs("view"):
            from turtlebot_gym_view import server  # noqa: F401  # what it lacks is said before the drives are driven
        if self.mount is not None and not self.drive:
            raise ValueError("--mount says where the LiDAR of a recorded drive is: add --drive, or leave it out.")
        if self.drive:
            drives = [read_recorded(path, lidar=self.lidar or "lds01", **self.reading()) for path in self.drive]
            title = f"Recorded: {', '.join(path.name for path in self.drive)}"
        else:
            drives = [record_episode(policy, env=self.env, seed=self.seed, **self.options()) for policy in self.policy]
            around = [name for name in (self.world, self.lidar, self.fix) if name]
            title = ", ".join([environment_id(self.env).partition("/")[2], *around, f"seed {self.seed}", f"noise {self.noise}"])
        self.show(drives, title=title)

    def show(self, drives: Sequence[Drive], *, title: str) -> None:
        """Show drives: in a file, or served until the process is interrupted."""
        with needs("view"):
            from turtlebot_gym_view.html import write_html
            from turtlebot_gym_view.server import serve
        if self.html is not None:
            print(f"{self.html}: {write_html(drives, self.html, title=title):,} bytes; open it in a browser.")
            return
        serve(drives, title=title, host=self.host, port=self.port)
