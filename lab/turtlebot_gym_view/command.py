"""The command ``watch``."""

from __future__ import annotations

import tempfile
import webbrowser
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from turtlebot_gym_agents.commands.console import needs
from turtlebot_gym_agents.evaluation.result import title_of
from turtlebot_gym_agents.flags import EnvironmentOptions
from turtlebot_gym_agents.ids import environment_id
from turtlebot_gym_agents.outputs import HTML, require_outputs
from turtlebot_gym_lab.commands.recorded import TOPICS, reading
from turtlebot_gym_lab.drives.topics import Topics
from turtlebot_gym_view.columns import require_number

if TYPE_CHECKING:
    from turtlebot_gym.drive import Drive
    from turtlebot_gym_view.page import Page

NONE: EnvironmentOptions = {}


def watch(
    *,
    policy: tuple[str, ...] = ("bearing",),
    env: str | None = None,
    seed: int = 0,
    allow_mismatch: bool = False,
    drive: tuple[Path, ...] = (),
    truth: str = "auto",
    columns: tuple[str, ...] = (),
    topics: Topics = TOPICS,
    mount: tuple[float, float, float] | None = None,
    html: Path | None = None,
    force: bool = False,
    options: Annotated[EnvironmentOptions, tyro.conf.OmitArgPrefixes] = NONE,
) -> str:
    """Show drives in a browser: an episode of each policy, or recorded drives. Play, select times, compare.

    Args:
        policy: Policies as for evaluate, at most six; all drive the same episode.
        env: Environment: nav, pose, square, rooms, missions, or the id of another one; by default rooms
            where a world or a LiDAR is given, otherwise nav.
        seed: Seed of the episode.
        allow_mismatch: Also drive policies made for another task, observation, robot or rate.
        drive: Recorded drives instead of episodes, as calibrate and replay take them.
        truth: As for replay.
        columns: As for replay.
        topics: Topics of a bag.
        mount: Pose of the LiDAR on the robot: x, y, heading; m, m, rad. Default: as the transforms of the bag state it, else as
            assumed, which is said.
        html: Write the view to this file, which opens without a network; by default a browser shows a temporary one.
        force: Overwrite a file that exists.
        options: Options of the environment.
    """
    require_outputs([("--html", html, HTML)], inputs=[*policy, *drive, *options.values()], force=force)
    if drive:
        require_number(len(drive))
        if unread := set(options) - {"lidar"}:
            raise ValueError(f"{', '.join(sorted(unread))} would change nothing in recorded drives: leave out it, or --drive.")
        given = {**reading(truth, columns, topics), "mount": mount, "lidar": options.get("lidar", "lds01")}
        title = f"Recorded: {', '.join(path.name for path in drive)}"
        page = page_of([read_recorded(path, **given) for path in drive], title=title)
    else:
        page = episodes(policy, env=env, seed=seed, allow_mismatch=allow_mismatch, **options)
    path = html or Path(tempfile.mkdtemp(prefix="watch-")) / "drives.html"
    size = page.save(path)
    if html is None:
        webbrowser.open(path.as_uri())
    return f"{path}: {size:,} bytes; open it in a browser."


def page_of(drives: Sequence[Drive], *, title: str) -> Page:
    """Return the page of drives, which a notebook shows."""
    with needs("agents"):
        from turtlebot_gym_view.page import Page
    return Page(drives=drives, title=title)


def episodes(policies: Sequence[Any], *, env: str | None, seed: int, allow_mismatch: bool = False, **options: Any) -> Page:
    """Drive an episode with each policy, and return their page.

    Raises:
        ValueError: If an argument is unknown or out of its range, or a policy cannot drive.
    """
    from turtlebot_gym_agents.evaluation.recording import record_episode

    require_number(len(policies))
    given = {"env": environment_id(env, options), "seed": seed, **options}
    drives = [record_episode(policy, allow_mismatch=allow_mismatch, **given) for policy in policies]
    return page_of(drives, title=title_of(given))


def read_recorded(path: Path, *, noise: str = "documented", **options: Any) -> Drive:
    """Read a recorded drive, as `turtlebot_gym_lab.drives.read`; if it has only wheels and truth, the filter is run over it."""
    from turtlebot_gym_lab.drives import read
    from turtlebot_gym_lab.evaluation.replay import replay, replayable

    drive = read(path, **options)
    return replay(replayable(drive), noise=noise) if drive.has_truth and not drive.has_odometry else drive
