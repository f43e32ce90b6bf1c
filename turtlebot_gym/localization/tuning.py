"""Assumptions of the localizer."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from turtlebot_gym.config import NON_NEGATIVE, ONE_OR_MORE, POSITIVE, PROBABILITY, Range, check_fields, given
from turtlebot_gym.rooms.lidar import Lidar

_BEAMS = Range(5, 10_000, whole=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class LocalizerTuning:
    """Assumptions of the localizer about LiDAR, map and wheels, and when it searches the whole map."""

    beams: Annotated[int, _BEAMS] = 20
    """Most beams of a scan that are used, evenly spread; those of the next scan lie between them."""
    deviation: Annotated[float, NON_NEGATIVE] = 0.005
    """Standard deviation of a range, m ..."""
    deviation_share: Annotated[float, NON_NEGATIVE] = 0.0175
    """... or as a share of the range, if that is more."""
    scale: Annotated[float, NON_NEGATIVE] = 0.029
    """Standard deviation of the share by which all ranges may be too long; 0 for a map made with the same LiDAR."""
    grain: Annotated[float, POSITIVE] = 0.014
    """Standard deviation of a surface in the map, m, independent from beam to beam."""
    bias: Annotated[float, NON_NEGATIVE] = 0.0003
    """Standard deviation of a position by errors of the map around it, m."""
    turn_bias: Annotated[float, NON_NEGATIVE] = 0.0002
    """The same for a heading, rad."""
    gate: Annotated[float, POSITIVE] = 3.0
    """Standard deviations beyond which a beam counts little."""
    iterations: Annotated[int, ONE_OR_MORE] = 4
    """Most Gauss-Newton steps per scan."""
    wide_steps: Annotated[int, ONE_OR_MORE] = 100
    """Gauss-Newton steps in which a beam's weight has the width of the prediction's covariance; later ones have that of the
    belief reached, in which beams that end at people count less."""
    thin: Annotated[float, Range(0.0, 2.0)] = 0.3
    """Cosine between beam and distance's gradient from which an end counts as behind a wall, or in its farther half; 2 for
    never."""
    along_walk: Annotated[float, NON_NEGATIVE] = 0.0
    """Standard deviation of the way, m per root of m: it grows with the root of the distance, whatever the time stamps."""
    along_step: Annotated[float, NON_NEGATIVE] = 0.03
    """The same as a share of a step's distance: slip, an early or late stamp."""
    aside_walk: Annotated[float, NON_NEGATIVE] = 0.0
    """Standard deviation across the way, m per root of m ..."""
    aside_step: Annotated[float, NON_NEGATIVE] = 0.0
    """... as a share of a step's distance ..."""
    aside_turn: Annotated[float, NON_NEGATIVE] = 0.0
    """... and per turn, m per rad: an unknown mount, a turn about another point."""
    turn_walk: Annotated[float, NON_NEGATIVE] = 0.0
    """Standard deviation of the heading, rad per root of m ..."""
    turn_step: Annotated[float, NON_NEGATIVE] = 0.05
    """... and as a share of a step's turn."""
    widening: Annotated[float, Range(1.0, 1e4)] = 1000.0
    """Largest factor of the wheels' variances, which grow until scans surprise no more than they should; 1 for none."""
    doubt: Annotated[float, PROBABILITY] = 0.7
    """Share of agreeing beams below which starts all around the prediction are tried; 0 for never."""
    short: Annotated[float, PROBABILITY] = 1.0
    """How much a beam that ends before a surface of the map says against a place, beside one that passes through; less than 1
    where people walk about."""
    suspicion: Annotated[float, PROBABILITY] = 0.08
    """Share of beams that do not fit, beyond twice the usual share, above which a scan fits badly, see `patience`."""
    reach: Annotated[float, NON_NEGATIVE] = 0.6
    """Least distance of these starts, m."""
    swing: Annotated[float, NON_NEGATIVE] = 0.6
    """Least turn of these starts, rad."""
    temper: Annotated[float, PROBABILITY] = 0.1
    """Share of a scan's log likelihood that counts where starts are compared: neighbouring beams see the same surfaces."""
    lead: Annotated[float, NON_NEGATIVE] = 0.0
    """By how much the logarithm of a place's weight must lead all others before it is believed."""
    trust: Annotated[float, PROBABILITY] = 0.0
    """Share of agreeing beams, averaged over some scans, that a place needs to be believed, and to be left in peace then."""
    evidence: Annotated[float, NON_NEGATIVE] = 0.0
    """Evidence for a place, in scans, that it needs to be believed: a metre of way counts as many scans."""
    patience: Annotated[int, ONE_OR_MORE] = 8
    """Scans that fit badly, less those that do not, after which the whole map is searched."""

    def __post_init__(self) -> None:
        check_fields(self)


ROBOT = LocalizerTuning(
    beams=60,
    deviation=0.02,
    deviation_share=0.005,
    scale=0.0,
    grain=0.05,
    bias=0.02,
    turn_bias=0.005,
    thin=2.0,
    along_walk=0.25,
    along_step=0.8,
    aside_walk=0.05,
    aside_step=0.1,
    aside_turn=0.25,
    turn_walk=0.06,
    turn_step=0.35,
    gate=1.5,
    temper=0.4,
    widening=1.0,
    doubt=0.9,
    suspicion=0.06,
    short=0.1,
    trust=0.9,
    evidence=30.0,
    wide_steps=2,
    lead=6.0,
    reach=0.3,
    swing=0.3,
)
"""Nothing is known about wheels, LiDAR and map; fitted to public recordings of buildings."""


def matched(lidar: Lidar) -> LocalizerTuning:
    """Return the tuning that matches a LiDAR; the share by which its ranges are too long is uniformly distributed."""
    return LocalizerTuning(
        deviation=lidar.deviation, deviation_share=lidar.deviation_share, scale=lidar.accuracy / math.sqrt(3.0)
    )


LOCALIZERS = {"match": matched, "robot": lambda lidar: ROBOT}
"""Tunings by name, as functions of the LiDAR in use."""


def make_localizer(tuning: str | Path | Mapping[str, Any] | LocalizerTuning, lidar: Lidar) -> LocalizerTuning:
    """Return a tuning for a LiDAR, given as such, as a mapping of its fields, by a name in `LOCALIZERS`, or by a file."""
    return given(LocalizerTuning, tuning, {name: make(lidar) for name, make in LOCALIZERS.items()}, "localizer")
