"""What is claimed of calibration is what was measured."""

import json
from pathlib import Path

from scipy import stats

BENCHMARKS = Path(__file__).parents[3] / "benchmarks"


def measured(name):
    return json.loads((BENCHMARKS / name).read_text(encoding="utf-8"))


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
