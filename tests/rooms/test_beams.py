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


REAL = {
    "LDS-01": (0.12, 3.5),
    "LDS-02": (0.0, 100.0),
    "RPLIDAR A1": (0.15, 12.0),
    "RPLIDAR S2": (0.05, 30.0),
    "Hokuyo URG-04LX": (0.02, 5.6),
    "Hokuyo UTM-30LX": (0.023, 60.0),
    "SICK LMS1xx": (0.5, 20.0),
    "SICK LMS5xx": (0.0, 80.0),
    "Velodyne, flattened": (0.9, 131.0),
    "pointcloud_to_laserscan": (0.45, math.inf),
    "without a limit": (0.0, float(np.finfo(np.float32).max)),
}


@pytest.mark.parametrize("name", REAL)
@pytest.mark.parametrize("ranges", [ROOM, HALL], ids=["room", "hall"])
def test_scans_of_real_lidars_are_read(name, ranges):
    least, most = REAL[name]
    lost = np.where(ranges > most, 0.0, ranges)
    for sent in (lost, np.where(ranges > most, np.inf, ranges), np.where(AROUND < 1.0, 65.533, lost)):
        read(sent, range_min=least, range_max=most)


@pytest.mark.parametrize(
    ("unit", "per_m", "limits"),
    [
        ("mm", 1000.0, [(0.12, 3.5), (0.12, 8.0), (0.15, 12.0), (0.0, 8.0)]),
        ("cm", 100.0, [(0.12, 3.5), (0.12, 8.0), (0.15, 12.0), (0.0, 8.0)]),
        ("inches", 39.37, [(0.12, 3.5), (0.12, 8.0), (0.15, 12.0)]),
    ],
)
def test_limits_in_another_unit_are_refused_with_the_unit(unit, per_m, limits):
    for least, most in limits:
        with pytest.raises(ValueError, match=f"no LiDAR measures .*range_max in {unit}\\?"):
            read(per_m * ROOM, range_min=per_m * least, range_max=per_m * most)


@pytest.mark.parametrize("per_m", [1000.0, 100.0, 39.37])
@pytest.mark.parametrize("limits", [(0.12, 3.5), (0.12, 8.0), (0.15, 12.0), (0.0, 8.0)])
@pytest.mark.parametrize("ranges", [ROOM, HALL, 0.3 * ROOM], ids=["room", "hall", "box"])
def test_ranges_in_another_unit_than_the_limits_are_refused(per_m, limits, ranges):
    for sent in (per_m * ranges, np.where(AROUND < 3.0, 0.0, per_m * ranges), np.where(AROUND < 3.0, np.inf, per_m * ranges)):
        with pytest.raises(ValueError, match=r"are they in mm, cm or inches\?"):
            read(sent, range_min=limits[0], range_max=limits[1])


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
