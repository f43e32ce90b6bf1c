"""The results page's section on real buildings, from `buildings.json`."""

from __future__ import annotations

from typing import Any

from harness.tables import markdown

PEERS = (
    ("nav2_amcl, defaults", "12 / 37 to 45 / 1 to 2", "12 / 27 / 0"),
    ("nav2_amcl, best of three settings", "5.9 / 21 / 0.6", "6.8 / 35 / 0.5 to 2"),
    ("the same, its map shifted by half a cell", "4.1 / 16 / 0", "5.1 / 22 / 0.3"),
    ("Beluga, defaults", "8 / 22 / 0", "11.6 / 25 / 0"),
)
"""Median and 95 % quantile, cm, and share beyond 0.5 m, %, in the first condition."""
IN_HUNDREDTHS = ("median", "quantile95", "worst", "lost", "declared_lost")
TEXT = """
## Real buildings

`make bench-buildings`: the localizer with the tuning `robot` on raw wheel odometry and scans of two recorded buildings.
The map is drawn from the scans at the reference key frames, the start is known, and errors are those at the key frames;
with "halves" at those that are not in the map. Each row differs from the first in what it names. Odometry off by 10 %
has all ways and turns 1.1 times as long; people are blocks of beams that end short. A pose is lost beyond 0.5 m; "says
so" is the share of rows at which the localizer calls itself lost. NEES is the median, 2.4 if the covariance were exact.
"""
FINDINGS = """
What does not hold, and why:

* People on half of the beams lose the robot in `aces`: too few beams fit for the right place to stand out. The localizer
  calls itself lost for 7 % of the rows and searches the whole map, 1.2 ms a scan on average, but no place explains the
  scans clearly better. In `intel` it calls itself lost for 6 % of them, and is nowhere.
* Odometry off by 20 % loses 1.4 % of the key frames of `aces`, and off by 10 % one of 440: its long corridors let the
  error along them grow.
* Backwards in the map of 10 cm one of the 440 key frames of `aces` is lost: at a corner, where 37 % of the beams fit.
* The other worst errors of `aces`, up to 54 cm, lie along one corridor, where nearly all beams fit: the covariance does
  not know of them.
* Medians are twice those that one scan alone reaches from the reference pose. The scan's delay and the laser's place on
  the robot are not estimated.

AMCL and Beluga on the same recordings, with the same maps of 5 cm, start and 60 beams: median, cm / 95 %, cm / lost, %.
They were measured once, outside of this command, by the libraries' own filters (nav2_amcl at a3a9704, Beluga at
947326f) called without ROS; ranges are over runs. AMCL reads a map's origin as the centre of its first cell, which the
shift undoes.
"""


def section(results: dict[str, Any]) -> str:
    """Return the section."""
    titles = ("building", "condition", "median, cm", "95 %, cm", "worst, cm", "lost, %", "says so, %", "NEES")
    rows = [
        (building, name, *(f"{100.0 * figure[key]:.1f}" for key in IN_HUNDREDTHS), f"{figure['nees']:.1f}")
        for building, conditions in results["buildings"].items()
        for name, figure in conditions.items()
    ]
    return "\n".join((TEXT, markdown(titles, rows), FINDINGS, markdown(("", "aces", "intel"), PEERS)))
