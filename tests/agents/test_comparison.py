"""Intervals and corrections: published examples, and coverage counted on simulated trainings, with wrong methods that fail."""

import math
from dataclasses import replace
from itertools import islice

import numpy as np
import pytest

from turtlebot_gym_agents.commands.verdict import verdicts
from turtlebot_gym_agents.evaluation import comparison, metrics
from turtlebot_gym_agents.evaluation.comparison import PairedOutcome
from turtlebot_gym_agents.evaluation.evaluate import evaluate
from turtlebot_gym_agents.evaluation.metrics import Interval

ROUNDED = 1e-4
"""The published limits have four digits, rounded from Wilson limits with z = 1.96."""
DATA_SETS = 2000
MARGIN = 4.5 * math.sqrt(0.05 * 0.95 / DATA_SETS)
"""A method that misses 5 % of the data sets is outside this for one seed in 1.5 * 10^5."""


def outcomes(successes: int, n: int) -> list[bool]:
    return [True] * successes + [False] * (n - successes)


@pytest.mark.parametrize(
    ("first", "second", "low", "high"),
    [  # Newcombe (1998), "... independent proportions: comparison of eleven methods", table II, method 10
        ((56, 70), (48, 80), 0.0524, 0.3339),
        ((9, 10), (3, 10), 0.1705, 0.8090),
        ((10, 10), (0, 20), 0.6791, 1.0),
    ],
)
def test_newcombes_interval_for_independent_shares(first, second, low, high):
    interval = metrics.share_difference(metrics.share(outcomes(*first)), metrics.share(outcomes(*second)))
    np.testing.assert_allclose(interval, [first[0] / first[1] - second[0] / second[1], low, high], rtol=0, atol=ROUNDED)
    back = metrics.share_difference(metrics.share(outcomes(*second)), metrics.share(outcomes(*first)))
    np.testing.assert_allclose(back, [-interval.value, -interval.high, -interval.low], rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("both", "first", "second", "neither", "low", "high"),
    [  # Newcombe (1998), "... binomial proportions based on paired data", table II, method 10
        (36, 12, 2, 0, 0.0569, 0.3404),
        (18, 12, 2, 18, 0.0562, 0.3290),
        (53, 0, 0, 1, -0.0729, 0.0729),
        (0, 30, 0, 0, 0.8395, 1.0),
    ],
)
def test_newcombes_interval_for_paired_shares(both, first, second, neither, low, high):
    events = [True] * (both + first) + [False] * (second + neither)
    others = [True] * both + [False] * first + [True] * second + [False] * neither
    interval = metrics.paired_share_difference(events, others)
    np.testing.assert_allclose(interval, [(first - second) / len(events), low, high], rtol=0, atol=ROUNDED)


@pytest.mark.parametrize(
    ("p_values", "adjusted"),
    [
        # 4 * 0.005, 3 * 0.01, 2 * 0.03, and 0.04 not below the one before it.
        ([0.01, 0.04, 0.03, 0.005], [0.03, 0.06, 0.06, 0.02]),
        # Holm's procedure in R's p.adjust, on five values; nothing is above 1.
        ([0.01, 0.02, 0.03, 0.04, 0.05], [0.05, 0.08, 0.09, 0.09, 0.09]),
        ([0.9, 0.6], [1.0, 1.0]),
    ],
)
def test_holms_correction(p_values, adjusted):
    assert metrics.holm(p_values) == pytest.approx(adjusted)


def tables(random, *, trainings=0.0, episodes=0.0, rest=1.0, k=5, n=60):
    """Yield tables with mean 0: trainings in rows, the same episodes in columns, deviations of each part."""
    for _ in range(DATA_SETS):
        row, column = random.normal(scale=trainings, size=(k, 1)), random.normal(scale=episodes, size=(1, n))
        yield row + column + random.normal(scale=rest, size=(k, n))


def missed(intervals, truth=0.0) -> float:
    """Return how often intervals do not contain the truth."""
    return float(np.mean([not interval.low <= truth <= interval.high for interval in intervals]))


SPREADS = [
    {"trainings": 1.0, "episodes": 1.0},
    {"trainings": 0.3, "episodes": 2.0},
    {"trainings": 0.0, "episodes": 2.0},
    {"trainings": 1.0, "episodes": 1.0, "k": 2},
]


@pytest.mark.parametrize("parts", [SPREADS[0], SPREADS[2], *(pytest.param(SPREADS[k], marks=pytest.mark.slow) for k in (1, 3))])
def test_intervals_over_trainings_have_the_stated_coverage(parts):
    errors = missed(comparison.spread(table).interval() for table in tables(np.random.default_rng(6), **parts))
    assert errors < 0.05 + MARGIN


def test_the_p_value_is_that_of_the_interval():
    for table in islice(tables(np.random.default_rng(9), trainings=1.0), 100):
        spread = comparison.spread(table)
        interval = spread.interval()
        assert (spread.p_value() < 0.05) == (not interval.low <= 0.0 <= interval.high)
        shifted = spread._replace(value=spread.margin(0.9))
        assert shifted.p_value() == pytest.approx(0.1)
    assert comparison.spread(np.zeros((2, 3))).p_value() == 1.0
    assert comparison.spread(np.ones((2, 3))).p_value() == 0.0


def test_by_hand():
    # Rows' means 2 and 4, variance 2: error^2 2/2. Columns' means 1, 3, 5, variance 4: error^2 4/3. Student's quantiles for 1
    # and 2 degrees of freedom, from a table: 12.706 and 4.303.
    spread = comparison.spread([[0.0, 2.0, 4.0], [2.0, 4.0, 6.0]])
    assert spread.value == 3.0
    assert spread.error() == pytest.approx(math.sqrt(7.0 / 3.0))
    assert spread.margin() == pytest.approx(math.sqrt(12.706**2 + 4.303**2 * 4.0 / 3.0), rel=1e-4)


@pytest.mark.parametrize(("share", "differ"), [(0.5, 0.0), (0.98, 60.0)])
def test_shares_over_trainings_have_the_stated_coverage(share, differ):
    # All trainings drove the same 100 episodes: Wilson's limit is 100 / (100 + 1.96^2).
    np.testing.assert_allclose(comparison.share(np.ones((5, 100), bool)), (1.0, 100.0 / (100.0 + 1.96**2), 1.0), atol=1e-5)
    # Each training has a rate of its own, beta distributed about the share; the wrong method takes all episodes as independent.
    random, right, wrong = np.random.default_rng(10), [], []
    for _ in range(DATA_SETS):
        rates = random.beta(share * differ, (1.0 - share) * differ, size=(5, 1)) if differ else np.full((5, 1), share)
        table = random.uniform(size=(5, 200)) < rates
        right.append(comparison.share(table))
        wrong.append(metrics.share(table.ravel()))
    assert missed(right, share) < 0.05 + MARGIN
    if differ:
        assert missed(wrong, share) > 0.05 + 4.0 * MARGIN


def test_trainings_compared_with_a_baseline():
    options = {"episodes": 40, "noise": "rough"}
    learned = [evaluate(policy, **options) for policy in ("bearing", "proportional", "bearing")]
    baseline = evaluate("bearing", **options)
    compared = comparison.compare(list(map(PairedOutcome.of, learned)), PairedOutcome.of(baseline))
    assert (compared["trainings"], compared["episodes"]) == (3, 40)
    np.testing.assert_allclose(compared["time_of_each_training"], [evaluation.times().mean() for evaluation in learned])
    np.testing.assert_allclose(compared["time"].value, np.mean(compared["time_of_each_training"]))
    assert compared["difference"].value == pytest.approx((learned[1].times() - baseline.times()).mean() / 3.0)
    assert compared["difference"].low < 0.0 < compared["difference"].high  # two of three are the baseline itself
    assert compared["p"] > 0.05
    assert compared["success"].value == pytest.approx((2.0 + learned[1].episodes.success.mean()) / 3.0)
    assert isinstance(compared["success_difference"], Interval)


N = 400


@pytest.fixture(scope="module")
def driven():
    """An evaluation whose numbers the tests replace: every goal is reached in 10 s."""
    made = evaluate("bearing", episodes=N, noise="clean")
    changed = made.episodes._replace(time=np.full(N, 10.0), success=np.ones(N, np.bool_))
    return replace(made, episodes=changed)


def with_(evaluation, **changes):
    return replace(evaluation, episodes=evaluation.episodes._replace(**changes))


def test_the_slower_policy_is_reported_with_its_interval(driven):
    spread = np.tile([-0.1, 0.1], N // 2)  # the standard error of the mean is 0.1 / sqrt(N - 1)
    slow = with_(driven, time=10.5 + spread)
    margin = 1.966 * 0.1 / np.sqrt(N - 1)
    ends = f"{0.5 - margin:.2f} to {0.5 + margin:.2f} s"
    assert verdicts({"a": driven, "b": slow}) == [f"b is {ends} slower than a; both reach every goal."]
    assert verdicts({"b": slow, "a": driven}) == [f"a is {ends} faster than b; both reach every goal."]


def test_goals_decide_before_time(driven):
    few = with_(driven, success=np.arange(N) >= N // 10)
    (sentence,) = verdicts({"a": driven, "b": few})
    assert sentence.startswith("b reaches ")
    assert " points fewer of the goals than a; it is " in sentence
    assert "s slower, a failure counted as the time limit." in sentence
    low, high = (float(word) for word in sentence.split()[2:5:2])
    assert low < 10.0 < high  # percent


def test_policies_are_compared_in_the_same_setting_and_a_single_policy_with_its_first_setting(driven):
    names = ("a, clean", "a, rough", "b, clean", "b, rough")
    sentences = verdicts(dict.fromkeys(names, driven), size=2)
    assert [sentence.partition(" (")[0] for sentence in sentences] == [
        f"b, {noise} is neither faster nor slower than a, {noise}" for noise in ("clean", "rough")
    ]
    (sentence,) = verdicts(dict.fromkeys(names[:2], driven), size=2)
    assert sentence.startswith("a, rough is neither faster nor slower than a, clean")
