"""A rotating LiDAR: the time and the range of each beam.

The beams of a revolution are spread over its period, and each is cast from the robot's pose at that time. A scan is complete
with the last beam of a revolution, and stays the newest one until the next revolution is complete. Beams are numbered from 0
through an episode, which starts at the end of a revolution at rest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated

from turtlebot_gym.config import FINITE, NON_NEGATIVE, POSITIVE, PROBABILITY, Numbers, Range, check_fields, refusal
from turtlebot_gym.kernel import floor, kernel
from turtlebot_gym.models.angles import TWO_PI, sincos
from turtlebot_gym.models.random import normals, uniforms

SECTORS = 36
"""Number of sectors into which a policy's ranges are pooled: the first is ahead, the others follow counter-clockwise."""
SIGHT = 3.5
"""Range beyond which a policy sees free space, m: that of the LiDAR with the shortest range, so that one policy works with
all."""
MAX_AGE = 1.0
"""Greatest age of a scan that a policy sees, s."""
DEAD_SECTORS = 4
"""Most blind sectors of a LiDAR."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Lidar:
    """A two-dimensional LiDAR: its beams, their errors and their timing."""

    beams: Annotated[int, Range(1, 10_000, whole=True)] = 360
    """Beams per revolution, evenly spaced counter-clockwise from `yaw`."""
    rate: Annotated[float, Range(0.01, 1e4, unit="Hz")] = 5.0
    """Revolutions per second; at most one per control interval."""
    range_min: Annotated[float, NON_NEGATIVE] = 0.12
    """Shorter ranges are not returned, m."""
    range_max: Annotated[float, POSITIVE] = 3.5
    """Longer ranges are not returned, m."""
    deviation: Annotated[float, NON_NEGATIVE] = 0.0
    """Standard deviation of a range, m ..."""
    deviation_share: Annotated[float, NON_NEGATIVE] = 0.0
    """... or as a share of the range, if that is more."""
    accuracy: Annotated[float, PROBABILITY] = 0.0
    """Largest share by which all ranges of an episode are too long or too short; drawn once per episode."""
    quantization: Annotated[float, NON_NEGATIVE] = 0.0
    """Resolution of a range, m; 0 for none."""
    dropout: Annotated[float, PROBABILITY] = 0.0
    """Probability that a beam returns nothing."""
    dead: tuple[tuple[float, float], ...] = ()
    """Blind sectors in the robot's frame: first direction and width of each, rad; at most 4."""
    x: Annotated[float, FINITE] = 0.0
    """Mounting position in the robot's frame, m."""
    y: Annotated[float, FINITE] = 0.0
    yaw: Annotated[float, FINITE] = 0.0
    """Direction of the first beam in the robot's frame, rad."""
    turning: bool = True
    """Whether beams are measured one after the other; if not, all at the end of the period."""
    stamped_at_end: bool = False
    """Whether a scan is stamped with the time of its last beam instead of its first."""

    def __post_init__(self) -> None:
        check_fields(self)
        if not self.range_min < self.range_max:
            raise ValueError(f"Lidar.range_min must be below range_max, got {self.range_min!r} >= {self.range_max!r}.")
        sectors = tuple(Numbers(FINITE, 2).check(f"Lidar.dead[{at}]", sector) for at, sector in enumerate(self.dead))
        if len(sectors) > DEAD_SECTORS or not all(0.0 <= width <= TWO_PI for _, width in sectors):
            raise refusal("Lidar.dead", f"at most {DEAD_SECTORS} pairs of a direction and a width up to 2 pi", self.dead)
        object.__setattr__(self, "dead", sectors + ((0.0, 0.0),) * (DEAD_SECTORS - len(sectors)))


# Data sheet: precision 10 mm below 0.5 m, 3.5 % beyond, taken as two standard deviations; accuracy 5 %. Mounted as on a Burger.
_LDS01 = Lidar(
    deviation=0.005, deviation_share=0.0175, accuracy=0.05, quantization=0.001, x=-0.032, stamped_at_end=True
)  # its driver stamps a complete scan
LIDARS = {
    "lds01": _LDS01,
    "lds02": replace(_LDS01, range_min=0.16, range_max=8.0, stamped_at_end=False),
    # RPLIDAR A1 on a TurtleBot 4: about 269 beams per scan, at 7.7 Hz; four posts block its view.
    "a1": Lidar(
        beams=269,
        rate=1.0 / 0.130,
        range_min=0.15,
        range_max=12.0,
        deviation_share=0.01,
        x=-0.04,
        yaw=math.pi / 2.0,
        dead=tuple((quarter * math.pi / 2.0 + math.pi / 4.0 - 0.05, 0.1) for quarter in range(4)),
    ),
    # Data sheet of the Hokuyo: 240 degrees, 0.36 degrees apart, 10 Hz, to 5.6 m; 10 mm below 1 m, 1 % beyond, taken as two
    # standard deviations. Looks ahead, from the middle of the robot.
    "urg04lx": Lidar(
        beams=1024,
        rate=10.0,
        range_min=0.02,
        range_max=5.6,
        deviation=0.005,
        deviation_share=0.005,
        quantization=0.001,
        dead=((TWO_PI / 3.0, TWO_PI / 3.0),),
    ),
    "ideal": Lidar(beams=36, rate=10.0, range_min=0.0, turning=False, stamped_at_end=True),
}
"""LiDARs by name."""


@kernel
def beams_by(at: int, lidar: Lidar, dt: float) -> int:
    """Return the number of beams measured by the end of a step."""
    share = at * dt * lidar.rate
    whole = math.floor(share + 1e-9)
    return math.floor((share if lidar.turning else whole) * lidar.beams + 1e-6)


@kernel
def time_of_beam(beam: float, lidar: Lidar) -> float:
    """Return the time at which a beam was measured, s since the start."""
    turned = (beam + 1.0) / lidar.beams
    return (turned if lidar.turning else math.ceil(turned)) / lidar.rate


@kernel
def age_of_scan(at: int, lidar: Lidar, dt: float) -> float:
    """Return the age of the newest complete scan at the end of a step, s, by its stamp.

    Stamps and their differences are whole nanoseconds.
    """
    revolutions = beams_by(at, lidar, dt) // int(lidar.beams)
    first = (revolutions - 1.0) / lidar.rate
    stamp = revolutions / lidar.rate if lidar.stamped_at_end or not lidar.turning else first
    return math.floor(max(at * dt - stamp, 0.0) * 1e9 + 0.5) / 1e9


@kernel
def aim(beams, lidar: Lidar) -> None:
    """Write what `scene.LidarBuffers.beams` says of each beam of a revolution; the least range of a blind one is infinite."""
    for beam in range(int(lidar.beams)):
        angle = lidar.yaw + TWO_PI * beam / lidar.beams
        beams[1, beam], beams[0, beam] = sincos(angle)
        blind = False
        for sector in lidar.dead:
            behind = angle - sector[0] - TWO_PI * math.floor((angle - sector[0]) / TWO_PI)
            blind = blind | (behind < sector[1])
        beams[2, beam] = math.inf if blind else lidar.range_min


@kernel
def quantize(value: float, resolution: float) -> float:
    """Round to a multiple of the resolution; a resolution of zero leaves the value as it is."""
    rounded = resolution * floor(value / (resolution if resolution > 0.0 else 1.0) + 0.5)
    return rounded if resolution > 0.0 else value


@kernel
def reading(length: float, least: float, beam: int, bias: float, key: int, lidar: Lidar, drawn: bool = True) -> float:
    """Return the measured range of a beam of a true length, m; infinite if nothing is returned, as below its ``least`` range.

    The beam is counted through the episode, and ``bias`` is the share by which all its ranges are too long. Where no error of
    the LiDAR depends on draws, the range is the same without them, and takes less time.
    """
    noise, _ = normals(key, beam, 0) if drawn else (0.0, 0.0)
    lost, _ = uniforms(key, beam, 1) if drawn and lidar.dropout > 0.0 else (1.0, 1.0)
    deviation = max(lidar.deviation, lidar.deviation_share * length)
    measured = quantize(length * (1.0 + bias) + deviation * noise, lidar.quantization)
    seen = (length <= lidar.range_max) & (measured >= least) & (measured <= lidar.range_max) & (lost >= lidar.dropout)
    return measured if seen else math.inf


@kernel
def bias_of(key: int, lidar: Lidar) -> float:
    """Return the share by which the ranges of an episode are too long, drawn from the key of its scans."""
    share, _ = uniforms(key, 0, 2)
    return (2.0 * share - 1.0) * lidar.accuracy
