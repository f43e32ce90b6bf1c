"""What is claimed of calibration is what was measured: the files that `make bench-calibration` leaves."""

import json
from pathlib import Path

import pytest
from scipy import stats

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
BLIND = ("R_x", "R_y", "R_theta", "bias_theta", "spike_probability", "spike", "alpha2", "alpha4", "scale")


def measured(name):
    return json.loads((BENCHMARKS / name).read_text(encoding="utf-8"))


@pytest.mark.parametrize("view", ["truth", "innovations"])
def test_intervals_hold_the_truth_as_often_as_they_say(view):
    told = measured("calibration.json")["coverage"][view]
    names = BLIND if view == "innovations" else tuple(told)
    assert len(names) == (9 if view == "innovations" else 14)
    held = drives = 0
    for name in names:
        one = told[name]
        n, hits = one["drives"], round(one["coverage"] * one["drives"])
        # each alone: a correct 95 % interval fails this for one in 1000 parameters
        low, high = stats.binom.interval(0.999, n, 0.95)
        assert low <= hits <= high, name
        held, drives = held + hits, drives + n
    assert 0.93 <= held / drives <= 0.97  # all together; intervals of 88 %, as those of a quadratic one would be, fail this


def test_a_calibrated_filter_knows_its_error_on_the_other_recorded_drive():
    for drive, told in measured("calibration_recorded.json")["recorded"].items():
        judged = told["judged"]
        assert judged["calibrated"]["nees"] <= 4.0 < judged["matched, uncalibrated"]["nees"], drive
        assert judged["calibrated"]["position"] <= judged["matched, uncalibrated"]["position"], drive
