"""Late fixes are rare: steps without one, and what follows for the few environments in which one arrives.

A step as a whole gives the same bits. Neither part has branches, so both run in vectors, the second only for vectors in which
a fix has arrived.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

from turtlebot_gym.estimation.ekf import EXTENDED_KALMAN
from turtlebot_gym.estimation.fixes import Remembered, taking_fixes
from turtlebot_gym.kernel import kernel
from turtlebot_gym.systems.fixes import TrackedFix, fix_parts
from turtlebot_gym.systems.open_ground import open_ground
from turtlebot_gym.systems.system import System
from turtlebot_gym.systems.world import Snapshot
from turtlebot_gym.values import Fix, senses_of


class LateFixes(NamedTuple):
    """A system with fixes that are some steps late, in two parts."""

    whole: System
    hurried: System
    """The system without what an arriving fix does; the task must not depend on the belief."""
    catch_up: Callable[..., Snapshot]
    """``catch_up(world, key, p)`` returns the world after a step of the hurried system, with what a fix does if one arrived."""


_Senses = senses_of(("odometry", "fix"))


@cache
def late_fixes(late: int) -> LateFixes:
    """Return the system of open ground with an extended Kalman filter that takes fixes ``late`` steps late, at least one."""
    (sensor, watch, measure), taking = fix_parts(late), taking_fixes(EXTENDED_KALMAN, late)
    insert_last = taking.insert_last

    @kernel
    def catch_up(world, key, p):
        fix, before = world.senses.fix, world.estimate
        pose, R, age, arrived, cross, passed = measure(fix, key, int(world.steps), p)
        oldest, newest = insert_last(before, Fix(pose, R, age, arrived, cross), p.tuning, p.middle)
        after = Remembered(newest.belief, newest.nis, newest, before.told, oldest, before.steps)
        senses = _Senses(world.senses.odometry, TrackedFix(pose, R, age, arrived, cross, passed) if fix.arrived else fix)
        return Snapshot(world.body, senses, after if fix.arrived else before, world.course, world.steps, world.room)

    hurried = open_ground(taking.filter._replace(step=taking.remember)).with_sensor(sensor._replace(sense=watch))
    return LateFixes(open_ground(taking.filter).with_sensor(sensor), hurried, catch_up)
