"""A drive as a moving picture, for notebooks and pages."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from turtlebot_gym.config import POSITIVE, as_int
from turtlebot_gym.drive import Drive
from turtlebot_gym.files import replacing
from turtlebot_gym.plotting import BLACK, GREEN, SKY_BLUE, VERMILLION, draw_map, draw_room, ellipse

if TYPE_CHECKING:
    from PIL.Image import Image

FRAMES = 60
"""Most pictures of a film: more would hardly look smoother, and a notebook should stay small."""
SIZE, DPI = 4.0, 80
"""Side of a picture, inches, and pixels per inch."""
COLOURS = 32
"""Colours of a picture."""


class Film:
    """An animated GIF, which a notebook shows."""

    def __init__(self, content: bytes) -> None:
        self.content = content
        """The file."""

    def save(self, path: str | Path) -> None:
        """Write it as a .gif; an existing file is replaced."""
        with replacing(Path(path)) as beside:
            beside.write_bytes(self.content)

    def __repr__(self) -> str:
        return "A moving picture of the drive; save(path) writes it as a .gif."

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> dict[str, str]:
        return {"image/gif": base64.b64encode(self.content).decode(), "text/plain": repr(self)}


def film_of(drive: Drive, *, seconds: float = 6.0, frames: int = FRAMES) -> Film:
    """Return a drive seen from above, as it goes: true path, measured poses, and the estimate with its ellipse.

    Args:
        drive: The drive.
        seconds: Length of the film, s.
        frames: Number of pictures.
    """
    from PIL.Image import Dither, Quantize  # slow to import

    POSITIVE.check("seconds", seconds)
    count = min(as_int("frames", frames, 2, 1000), len(drive))
    rows = np.unique(np.linspace(0, len(drive) - 1, count).astype(int))
    pictures = list(_pictures(drive, rows.tolist()))
    content, pause = io.BytesIO(), 1000.0 * seconds / len(pictures)
    durations = [round(pause)] * (len(pictures) - 1) + [1500]
    # The last picture has all colours; the other way of choosing them would drop those of thin lines.
    palette = pictures[-1].quantize(COLOURS, method=Quantize.MAXCOVERAGE)
    first, *others = (picture.quantize(palette=palette, dither=Dither.NONE) for picture in pictures)
    first.save(content, format="GIF", save_all=True, append_images=others, duration=durations, loop=0, optimize=True)
    return Film(content.getvalue())


def _pictures(drive: Drive, rows: list[int]) -> Iterator[Image]:
    """Yield a picture of the drive up to each row."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # slow to import
    from matplotlib.figure import Figure
    from PIL import Image

    figure = Figure(figsize=(SIZE, SIZE), dpi=DPI, layout="tight")
    canvas, axes = FigureCanvasAgg(figure), figure.subplots()
    axes.set_aspect("equal", adjustable="datalim")
    if drive.around.room is not None:
        draw_room(axes, drive.around.room)
    if drive.around.grid is not None:
        draw_map(axes, drive.around.grid)
    truth, estimate, odometry = drive.true_state, drive.estimate, drive.odometry
    everything = np.concatenate([truth[:, :2], odometry[:, :2], drive.reference[:, :2]])
    axes.update_datalim(everything[np.isfinite(everything).all(1)])
    axes.autoscale_view()
    axes.set(xlabel="x (m)", ylabel="y (m)")
    (dots,) = axes.plot([], [], ".", color=SKY_BLUE, markersize=3.0, label="odometry")
    (path,) = axes.plot([], [], "-", color=BLACK, linewidth=1.8, label="truth")
    (believed,) = axes.plot(
        [], [], "-", color=VERMILLION, linewidth=2.0, zorder=4.0, label="estimate ± 2\N{GREEK SMALL LETTER SIGMA}"
    )
    (goal,) = axes.plot([], [], "o", color=GREEN, fillstyle="none", markersize=9.0, label="waypoint")
    (robot,) = axes.plot([], [], "-", color=BLACK, linewidth=4.0, zorder=5.0)
    axes.legend(loc="upper right", fontsize="x-small", framealpha=0.9)
    for row in rows:
        x, y, theta = truth[row, :3]
        dots.set_data(*odometry[: row + 1, :2].T)
        path.set_data(*truth[: row + 1, :2].T)
        believed.set_data(*ellipse(estimate[row], drive.covariance[row]).T)
        goal.set_data(*drive.reference[row : row + 1, :2].T)
        robot.set_data([x, x + 0.2 * np.cos(theta)], [y, y + 0.2 * np.sin(theta)])
        axes.set_title(f"{drive.time[row] - drive.time[0]:.1f} s", fontsize="small")
        canvas.draw()
        yield Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
