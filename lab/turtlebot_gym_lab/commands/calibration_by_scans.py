"""``calibrate`` where a log has scans, and neither truth nor map nor tape: scan against scan."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.table import Table

from turtlebot_gym_agents.commands.console import print_tables, progress, save_figure
from turtlebot_gym_lab.commands.calibration_report import interval_text, tables_beside

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from turtlebot_gym import Noise
    from turtlebot_gym.drive import Drive
    from turtlebot_gym_lab.calibration import CalibrationEstimate
    from turtlebot_gym_lab.commands.calibrate import Calibrate
    from turtlebot_gym_lab.scans.calibrating import ByScans
    from turtlebot_gym_lab.scans.judging import HeldOut

CAPS = {"alpha1": 0.1, "alpha2": 0.025, "alpha3": 2.5, "alpha4": 0.1}
"""Largest alphas in a file: the upper end of an interval may be anything."""
SAME = (0.01, 0.01, 0.02)
"""Difference of two mounts that is none, m, m, rad."""
STEPS = 4
"""Parts of a calibration, for its progress bar."""


def applies(drive: Drive, kind: str | None, *, use_truth: bool) -> bool:
    """Return whether scans are all that can tell a drive's wheels."""
    from turtlebot_gym_lab.calibration.calibrate import detect_kind
    from turtlebot_gym_lab.calibration.estimates import WHEELS

    if not drive.scans or not drive.has_odometry or (drive.has_truth and use_truth):
        return False
    return (detect_kind(drive) if kind is None else kind) == WHEELS


def run(command: Calibrate, drive: Drive) -> None:
    """Calibrate a drive by its scans, print, and write the files."""
    from turtlebot_gym import write_parameters
    from turtlebot_gym_agents.provenance import provenance
    from turtlebot_gym_lab.scans.calibrating import by_scans, estimates_of
    from turtlebot_gym_lab.scans.judging import held_out
    from turtlebot_gym_lab.scans.turning import gyro_by_scans

    for name in ("integrator", "delay"):
        if getattr(command, name) is not None:
            raise ValueError(
                f"--{name} is for a truth, and {command.log.name} has none: scan is compared with scan; leave it out."
            )
    done = 0
    with progress(STEPS) as advance_to:

        def advance(part: str) -> None:
            nonlocal done
            done += 1
            advance_to(done)

        found = by_scans(drive, advance)
    estimates, judged, gyro = estimates_of(found), held_out(found), gyro_by_scans(drive, found)
    noise, remarks = noise_of(estimates), remarks_of(drive, found)
    print_tables(*tables_of(estimates, found, remarks, gyro, title=command.log.name))
    print(judged.text)
    refused = ""
    if command.out is not None and not (judged.is_good or command.force):
        refused = f"{command.out} is not written: {judged.text} Record another drive, or write it with --force."
    elif command.out is not None:
        text = comment(estimates, judged, remarks, command.log.name, provenance()["version"])
        write_parameters(noise, command.out, comment=text)
    command.report(
        {
            "source": "scan against scan",
            "noise": asdict(noise),
            "estimates": {name: asdict(each) | {"is_determined": each.is_determined} for name, each in estimates.items()},
            "mount": found.mount._asdict() | {"upside_down": found.upside_down},
            "gyro": None if gyro is None else gyro._asdict(),
            "held_out": judged._asdict(),
            "pairs": len(found.pairs.first),
            "scans": found.pairs.scans,
            "remarks": remarks,
        }
    )
    if command.plot is not None:
        save_figure(figure_of(drive, found, title=command.log.name), command.plot)
    if refused:
        raise ValueError(refused)


def noise_of(estimates: dict[str, CalibrationEstimate]) -> Noise:
    """Return the noise model for a file: wheel odometry with the wheels found, and the worst alphas that the log allows."""
    from turtlebot_gym import Noise, OdometryNoise, ProcessNoise

    alphas = {}
    for name, cap in CAPS.items():
        estimate = estimates[name]
        alphas[name] = min(estimate.value if estimate.is_determined else estimate.high, cap)
    wheels = {name: estimates[name].value for name in ("scale", "turn_scale", "veer")}
    return Noise(process=ProcessNoise(**alphas, **wheels), odometry=OdometryNoise(wheel=True))


def remarks_of(drive: Drive, found: ByScans) -> list[str]:
    """Return what the scans show beside the estimates."""
    x, y, yaw = found.mount
    remarks = [
        *drive.remarks,
        f"no truth and no map: scan is compared with scan, {len(found.pairs.first)} pairs of {found.pairs.scans} scans",
        "lengths are in the LiDAR's metres: ranges that are 1 % too long make scale 1 % too great; a tape or a map tells",
    ]
    if found.pairs.lost:
        remarks.append(f"{found.pairs.lost} scans fit none before them: left out")
    stated, off = drive.scans[0].mount, found.fit.reach * found.fit.deviation[3:6]
    apart = np.abs([x - stated.x, y - stated.y, math.remainder(yaw - stated.theta, 2.0 * math.pi)])
    if ((apart > off) & (apart > SAME) & found.determined[3:6]).any():
        remarks.append(
            f"the LiDAR is stated at x {stated.x:.3f} m, y {stated.y:.3f} m, turned by {stated.theta:.3f} rad, and found "
            f"elsewhere: static_transform_publisher --x {x:.4f} --y {y:.4f} --yaw {yaw:.4f}"
        )
    if found.upside_down:
        remarks.append("the LiDAR turns the other way than stated: it hangs upside down (a roll of pi)")
    return remarks


def tables_of(
    estimates: dict[str, CalibrationEstimate], found: ByScans, remarks: list[str], gyro: Any, *, title: str
) -> list[Table]:
    """Return tables of estimates, of what the log does not determine, and of remarks."""
    table = Table("", "value", "95 % interval", "unit", title=f"{title}: wheels and mount, scan against scan")
    for name, estimate in estimates.items():
        interval = interval_text(estimate) if estimate.is_determined else "not determined"
        table.add_row(name, f"{estimate.value:.4g}", interval, estimate.unit)
    if gyro is not None:
        for name, (value, low, high), unit in (("gyro_scale", gyro.scale, ""), ("gyro_bias", gyro.bias, "rad/s")):
            table.add_row(name, f"{value:.4g}", f"{low:.4g} to {high:.4g}", unit)
    return [table, *tables_beside(estimates, remarks)]


def comment(estimates: dict[str, CalibrationEstimate], judged: HeldOut, remarks: list[str], name: str, version: str) -> str:
    """Return the comment above the numbers in a noise file."""
    lines = [f"Calibrated from {name} by turtlebot-gym {version}: scan against scan."]
    for key, estimate in estimates.items():
        ends = f"95 % interval {interval_text(estimate)} {estimate.unit}".rstrip()
        said = ends if estimate.is_determined else f"not determined: {estimate.remedy}"
        lines.append(f"{key}: {estimate.value:.4g}, {said}")
    return "\n".join([*lines, *(f"Found: {remark}" for remark in remarks), judged.text])


def figure_of(drive: Drive, found: ByScans, *, title: str) -> Figure:
    """Return a figure of the paths by the wheels as assumed, by the wheels found, and by the scans."""
    from matplotlib.figure import Figure

    from turtlebot_gym.plotting import BLUE, ORANGE, VERMILLION
    from turtlebot_gym_lab.scans.calibrating import with_truth

    figure = Figure(figsize=(6.0, 6.0), layout="constrained")
    axes = figure.subplots()
    truth = with_truth(drive, found).truth
    truth = truth[np.isfinite(truth[:, 0])]
    axes.plot(*found.odometry[:, :2].T, color=ORANGE, linewidth=1.0, label="wheels as assumed")
    axes.plot(*found.path[:, :2].T, "--", color=BLUE, linewidth=1.0, label="wheels found")
    axes.plot(*truth[:, :2].T, ".", color=VERMILLION, markersize=3.0, label="scan by scan")
    axes.set(title=title, xlabel="x, m", ylabel="y, m", aspect="equal")
    axes.grid(alpha=0.3)
    axes.legend()
    return figure
