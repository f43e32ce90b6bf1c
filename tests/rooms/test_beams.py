"""Scans in other units than m, and with limits that no LiDAR has, are refused with the cause; those of real LiDARs are not."""

import math

import numpy as np
import pytest

from turtlebot_gym.beams import beams_of, gaps_of

AROUND = 2.0 * math.pi / 360 * np.arange(360)
ROOM = 1.5 / np.maximum(np.abs(np.cos(AROUND)), np.abs(np.sin(AROUND)))
"""Ranges in a room of 3 m x 3 m, m."""
HALL = 4.0 * ROOM


def read(ranges, *, range_min=0.12, range_max=3.5):
    return beams_of(ranges, first=0.0, increment=2.0 * math.pi / len(ranges), range_min=range_min, range_max=range_max)


REAL = [(0.12, 3.5), (0.0, 100.0), (0.15, 12.0), (0.05, 30.0), (0.02, 5.6), (0.5, 20.0), (0.0, 80.0), (0.9, 131.0)]
"""Limits of LDS-01 and 02, RPLIDAR A1 and S2, Hokuyo URG-04LX, SICK LMS1xx and 5xx, and of a flattened Velodyne, m."""
FORMAL = [(0.45, math.inf), (0.0, float(np.finfo(np.float32).max))]
"""Limits that say there is none."""
UNITS = {"mm": 1000.0, "cm": 100.0, "inches": 39.37}


@pytest.mark.parametrize("limits", REAL + FORMAL)
@pytest.mark.parametrize("ranges", [ROOM, HALL], ids=["room", "hall"])
def test_scans_of_real_lidars_are_read(limits, ranges):
    least, most = limits
    lost = np.where(ranges > most, 0.0, ranges)
    for sent in (lost, np.where(ranges > most, np.inf, ranges), np.where(AROUND < 1.0, 65.533, lost)):
        read(sent, range_min=least, range_max=most)


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("limits", [(0.12, 3.5), (0.12, 8.0), (0.15, 12.0)])
def test_scans_in_another_unit_are_refused_in_their_limits_or_ranges(unit, limits):
    (least, most), per_m = limits, UNITS[unit]
    with pytest.raises(ValueError, match=f"no LiDAR measures .*range_max in {unit}\\?"):
        read(per_m * ROOM, range_min=per_m * least, range_max=per_m * most)
    for ranges in (per_m * ROOM, per_m * HALL, per_m * 0.3 * ROOM):
        for sent in (ranges, np.where(AROUND < 3.0, 0.0, ranges), np.where(AROUND < 3.0, np.inf, ranges)):
            with pytest.raises(ValueError, match=r"are they in mm, cm or inches\?"):
                read(sent, range_min=least, range_max=most)


@pytest.mark.parametrize("most", [100.0, math.inf])
def test_ranges_in_mm_of_a_lidar_that_states_no_real_limit_are_refused(most):
    with pytest.raises(ValueError, match="are they in mm"):
        read(1000.0 * ROOM, range_min=0.0, range_max=most)


def test_one_number_beyond_the_limits_is_a_drivers_sign_for_nothing():
    assert np.isinf(read(np.full(360, 65.533)).ranges).all()


@pytest.mark.parametrize(("beams", "found"), [(4, 4), (8, 8), (10, 10), (11, 0), (360, 0)])
def test_beams_wider_apart_than_the_widest_leave_gaps(beams, found):
    widest = math.radians(33.4)
    gaps = gaps_of(read(np.full(beams, 2.0)), widest)
    assert len(gaps) == found
    for first, last, width, shorter in gaps:
        assert width == pytest.approx(2.0 * math.pi / beams)
        assert width - (last - first) <= widest + 1e-9  # what is left at the edges is narrower than the robot
        assert shorter == 2.0
    assert len(gaps_of(read(np.full(beams, 2.0)))) == 0
