"""Tuned baselines: the search finds better numbers and resumes; its file is a policy, or is refused with the reason."""

import json

import numpy as np
import pytest

from turtlebot_gym import ROBOTS
from turtlebot_gym.observations import OPEN_GROUND, size_of
from turtlebot_gym_agents.commands.cli import main
from turtlebot_gym_agents.evaluation.evaluate import NAV, evaluate
from turtlebot_gym_agents.evaluation.tune_baseline import best_of, tune_baseline
from turtlebot_gym_agents.policies import POLICIES, BearingPolicy, make_policy
from turtlebot_gym_agents.policies.baselines import load_baseline

ROOMS = "turtlebot_gym/TurtleBotRooms-v0"
SQUARE = "turtlebot_gym/TurtleBotSquare-v0"
FIRST = 549_755_813_888  # 2^39: the tries' first seed
SMALL = {"tries": 4, "episodes": 20}


@pytest.fixture
def tuned(tmp_path):
    """A tuned baseline, as a file and as the content that a test may spoil."""
    path = tmp_path / "bearing.json"
    tune_baseline("bearing", path, **SMALL)
    return path


def test_the_first_try_has_the_defaults_and_seeds_are_separate(tmp_path):
    tries = tune_baseline("corner", tmp_path / "corner.json", env=SQUARE, noise="rough", tries=2, episodes=30, seed=1)
    assert tries[0].numbers == {"cut": 0.26, "depth": 0.75, "gain": 6.0, "focus": 0.5, "tolerance": 0.03, "slow": 0.05}
    by_hand = evaluate("corner", env=SQUARE, noise="rough", episodes=30, seed=FIRST + 2**20)
    assert tries[0].time == by_hand.times().mean()
    assert tries[0].success == by_hand.episodes.success.mean()
    assert tries[1].numbers.keys() == tries[0].numbers.keys()
    assert all(tries[1].numbers[name] != number for name, number in tries[0].numbers.items())


def test_a_scenario_that_the_defaults_do_not_suit_gets_other_numbers(tmp_path):
    # On raw odometry the defaults turn after every measurement: 16.5 s over 2000 episodes, and 12.2 s when tuned.
    path = tmp_path / "bearing.json"
    options = {"observation": "odometry", "noise": "tutorial"}
    tries = tune_baseline("bearing", path, tries=16, episodes=150, **options)
    best = best_of(tries)
    assert best.time == min(attempt.time for attempt in tries) < 0.85 * tries[0].time
    fresh = {"episodes": 300, "seed": 77, **options}
    assert evaluate(str(path), **fresh).times().mean() < 0.9 * evaluate("bearing", **fresh).times().mean()


@pytest.mark.parametrize("name", POLICIES)
def test_numbers_stay_in_their_ranges_and_the_file_is_the_best_try(name, tmp_path):
    path = tmp_path / "tuned.json"
    terms, ranges = POLICIES[name].terms, POLICIES[name].ranges()
    env = NAV if terms == OPEN_GROUND else ROOMS
    tries = tune_baseline(name, path, env=env, tries=8, episodes=5)
    for attempt in tries:
        assert attempt.numbers.keys() == ranges.keys()
        assert all(span.low <= attempt.numbers[number] <= span.high for number, span in ranges.items())
    assert json.loads(path.read_text())["numbers"] == best_of(tries).numbers
    sights = np.random.default_rng(0).uniform(-1.0, 1.0, (50, size_of(terms))).astype(np.float32)
    if terms != OPEN_GROUND:
        sights[:, 13:] = np.abs(sights[:, 13:])
    expected = POLICIES[name](ROBOTS["burger"], 0.1, **best_of(tries).numbers)(sights)
    np.testing.assert_array_equal(make_policy(str(path))(sights), expected)


def test_a_stopped_search_resumes_as_if_nothing_had_happened(tmp_path):
    whole = tune_baseline("bearing", tmp_path / "whole.json", tries=6, episodes=10)

    def stop(ended):
        if ended == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        tune_baseline("bearing", tmp_path / "parts.json", tries=6, episodes=10, progress=stop)
    assert len(json.loads((tmp_path / "parts.json").read_text())["tries"]) == 4
    counts = []
    assert tune_baseline("bearing", tmp_path / "parts.json", tries=6, episodes=10, progress=counts.append) == whole
    assert counts == [4, 5, 6]
    with pytest.raises(ValueError, match="another configuration"):
        tune_baseline("bearing", tmp_path / "parts.json", tries=6, episodes=10, noise="rough")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"episodes": 2.5}, r"episodes must be a whole number of at least 1, got 2\.5"),
        ({"seed": -1}, "seed must be a whole number from 0 to 9223372036854775807"),
        ({"noise": "loud"}, "noise must be one of 'clean'"),
    ],
)
def test_invalid_arguments_of_a_tuning_are_refused(options, message, tmp_path):
    with pytest.raises(ValueError, match=message):
        tune_baseline("bearing", tmp_path / "best.json", **SMALL | options)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "content", [b"", b"[]", b"{}", b'{"tries": 3}', b"\x00", b"\xff\xfe\x00", b"null", b"{", b'{"format": 1}']
)
def test_a_file_that_is_not_a_tuned_baseline_is_refused_and_not_changed(content, tmp_path):
    path = tmp_path / "odd.json"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"odd\.json is not a tuned baseline"):
        make_policy(str(path))
    with pytest.raises(ValueError, match="is not a tuned baseline: choose another file"):
        tune_baseline("bearing", path, **SMALL)
    assert path.read_bytes() == content


def test_a_tuned_baseline_is_refused_for_another_robot_or_rate(tuned):
    assert isinstance(make_policy(str(tuned)), BearingPolicy)
    assert isinstance(load_baseline(tuned), BearingPolicy)
    for options, wanted in (({"dt": 0.05}, "20 Hz burger"), ({"robot": "waffle"}, "10 Hz waffle")):
        with pytest.raises(ValueError, match=f"made for 10 Hz burger, asked for {wanted}"):
            make_policy(str(tuned), **options)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": "turtlebot-gym-baseline/2"}, "but this version reads"),
        ({"policy": "ppo"}, "policy must be one of"),
        ({"policy": None}, "policy must be one of"),
        ({"numbers": {"speed": 3.0}}, "bearing has no numbers speed"),
        ({"numbers": {"gain": "fast"}}, "is not a tuned baseline"),
        ({"numbers": {"gain": None}}, "is not a tuned baseline"),
        ({"numbers": {"gain": -1.0}}, "gain must be a positive number"),
        ({"numbers": {"gain": float("nan")}}, "gain must be a positive number"),
        ({"numbers": 3}, "is not a tuned baseline"),
        ({"robot": {"name": "x"}}, "is not a tuned baseline"),
        ({"robot": {"name": "x", "max_linear": -1.0, "max_angular": 1.0}}, "must be a positive number"),
        ({"robot": None}, "is not a tuned baseline"),
        ({"dt": float("nan")}, "dt must be a positive number"),
        ({"dt": "0.1"}, "is not a tuned baseline"),
    ],
)
def test_a_spoilt_file_is_refused_with_the_reason(change, message, tuned):
    tuned.write_text(json.dumps(json.loads(tuned.read_text()) | change))
    with pytest.raises(ValueError, match=message):
        make_policy(str(tuned))


def test_the_command_writes_a_policy_and_its_tries(tmp_path, capsys):
    out, report = tmp_path / "corner.json", tmp_path / "tries.json"
    search = ["--tries", "3", "--episodes", "10", "--delay", "1", "--out", str(out), "--json", str(report)]
    assert main(["tune-baseline", "--policy", "corner", "--env", SQUARE, *search]) == 0
    printed = capsys.readouterr().out
    assert "the best of 3" in printed
    assert printed.count("depth ") == 3
    content = json.loads(report.read_text())
    assert content["config"]["delay"] == json.loads(out.read_text())["config"]["delay"] == 1
    written = json.loads(out.read_text())["tries"]
    assert [attempt["numbers"] for attempt in content["tries"]] == [attempt["numbers"] for attempt in written]
    driven = ["--env", SQUARE, "--policy", "bearing", str(out), "--delay", "1", "--episodes", "5"]
    assert main(["evaluate", *driven, "--json", str(report), "--force"]) == 0
    assert json.loads(report.read_text())["runs"][1]["config"].items() >= {"delay": 1, "policy": str(out)}.items()
