"""What is claimed of calibration is what was measured."""

import json
from pathlib import Path

from scipy import stats

BENCHMARKS = Path(__file__).parents[3] / "benchmarks"
BLIND = ("R_x", "R_y", "R_theta", "bias_theta", "spike_probability", "spike", "alpha2", "alpha4", "scale")


def measured(name):
    return json.loads((BENCHMARKS / name).read_text(encoding="utf-8"))


def test_intervals_from_innovations_hold_the_truth_as_often_as_they_say():
    coverage = measured("calibration.json")["coverage"]["innovations"]
    held = drives = 0
    for name in BLIND:
        parameter = coverage[name]
        n, hits = parameter["drives"], round(parameter["coverage"] * parameter["drives"])
        # each alone: a correct 95 % interval fails this for one in 1000 parameters
        low, high = stats.binom.interval(0.999, n, 0.95)
        assert low <= hits <= high, name
        held, drives = held + hits, drives + n
    assert 0.93 <= held / drives <= 0.97  # all together; intervals of 88 %, as those of a quadratic one would be, fail this


def test_intervals_with_the_truth_hold_it_as_often_as_they_say():
    settings = measured("calibration_intervals.json")["coverage"]
    assert len(settings) == 8
    rows = [row for setting in settings.values() for row in setting["parameters"].values()]
    far = [row for row in rows if not row["interval"][0] <= 0.95 <= row["interval"][1]]
    # At a level of 99 % one parameter in a hundred is further off by chance; five or more are in one study of 10^4.
    assert len(rows) > 100
    assert len(far) < 5
    for name, setting in settings.items():
        # All parameters of a setting: correct intervals fail this for one study in 1000.
        intervals = sum(row["drives"] for row in setting["parameters"].values())
        low, high = stats.binom.interval(1.0 - 1e-3 / len(settings), intervals, 0.95)
        assert low <= round(setting["all"] * intervals) <= high, name


def test_a_calibrated_filter_knows_its_error_on_the_other_recorded_drive():
    for drive, results in measured("calibration_recorded.json")["recorded"].items():
        judged = results["judged"]
        assert judged["calibrated"]["nees"] <= 4.0 < judged["matched, uncalibrated"]["nees"], drive
        assert judged["calibrated"]["position"] <= judged["matched, uncalibrated"]["position"], drive
