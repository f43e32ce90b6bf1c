"""The law of the collision monitor, on drives towards walls with scans that end, are late or come from two computers' clocks.

**No motion in force later than 0.4 s after the newest scan that was sent, and none within 0.05 m and 8.5 % of the range of a
wall.** The wheels hold their last command, so silence is no stop.
"""

import math

import numpy as np
import pytest
from burger import Parameters

from cmd_vel_guard.arbiter import Arbiter
from cmd_vel_guard.collision import RawScan
from cmd_vel_guard.sent import Ages, SystemClock
from cmd_vel_guard.values import STOP, Command

AROUND = 2.0 * math.pi / 360 * np.arange(360)
FRONT, LIDAR = 0.105 - 0.024, -0.032
"""Front of a Burger's footprint, and its LiDAR, ahead of the axle, m."""
TICK, EPSILON = 0.02, 1e-6
SYSTEM = 1.7e9


def wall(away, rng):
    """Ranges in a round hall with a wall at a distance ahead of the LiDAR, m."""
    cosine = np.cos(AROUND)
    ranges = np.minimum(np.where(cosine > 0.05, away / np.maximum(cosine, 0.05), 3.0), 3.0)
    return (ranges + rng.normal(0.0, 1e-4, 360)).astype(np.float32)


def broken(seed):
    """Return which clauses of the law a drive breaks."""
    rng = np.random.default_rng(seed)
    arbiter, clock = Arbiter(Parameters(collision_monitor=True), 100.0), SystemClock()
    ages, said = Ages(clock), set()
    x, held, away = 0.0, STOP, rng.uniform(0.4, 1.2)
    ends = rng.choice([math.inf, rng.uniform(0.5, 4.0)])
    late, ahead = rng.choice([0.0, 0.0, 0.1, 0.6]), rng.choice([0.0, 0.775, -0.1])
    source, speed = rng.choice(["program", "teleop"]), rng.uniform(0.1, 0.3)
    newest, flying = -math.inf, []
    for k in range(round(7.0 / TICK)):
        now = 100.0 + k * TICK
        clock.look(system=SYSTEM + now, steady=now)
        if k % 10 == 0 and now - 100.0 < ends:
            delay = late if k > 100 else 0.0
            flying.append((now + delay, now, RawScan(wall(away - x - LIDAR, rng), 0.0, AROUND[1], 0.12, 3.5, "base_scan")))
        for entry in [entry for entry in flying if entry[0] <= now]:
            flying.remove(entry)
            stamp = SYSTEM + entry[1] + ahead
            age = ages.age(steady=now, source=stamp, arrival=SYSTEM + now, header=stamp)
            arbiter.hear_scan(entry[2], now, sent=now - age.since(0.2), dated=age.dated)
            newest = max(newest, entry[1])
        if k % 5 == 0:
            arbiter.hear(source, Command(speed, 0.0), now)
        command = arbiter.step(now)
        held = held if command is None else command
        x += held.v * TICK
        # A clock that is ahead may hide a delay that never fell below its lead, a header that of one revolution.
        if held != STOP and now > newest + 0.4 + 0.2 + TICK + EPSILON:
            said.add("motion without a scan of the last 0.4 s")
        if away - x - FRONT < 0.05 + 0.085 * (away - x - LIDAR) - EPSILON:
            said.add("within the margin")
    return said


@pytest.mark.parametrize("seeds", [range(16), pytest.param(range(16, 200), marks=pytest.mark.slow)], ids=["16", "184"])
def test_the_law_of_the_monitor_holds(seeds):
    assert [clause for seed in seeds for clause in broken(seed)] == []
