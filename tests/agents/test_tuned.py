"""A baseline of one's own numbers is a file, and a policy; or it is refused with the reason."""

import json

import pytest

from turtlebot_gym_agents.policies import BearingPolicy, make_policy
from turtlebot_gym_agents.policies.baselines import FORMAT, default_numbers, load_baseline
from turtlebot_gym_agents.policies.fit import describe_robot


@pytest.fixture
def tuned(tmp_path):
    """A baseline's file, whose content a test may spoil."""
    path = tmp_path / "bearing.json"
    made = {"format": FORMAT, "policy": "bearing", "robot": describe_robot("burger"), "dt": 0.1}
    path.write_text(json.dumps({**made, "numbers": default_numbers("bearing")}))
    return path


@pytest.mark.parametrize(
    "content", [b"", b"[]", b"{}", b'{"tries": 3}', b"\x00", b"\xff\xfe\x00", b"null", b"{", b'{"format": 1}']
)
def test_a_file_that_is_not_a_baseline_is_refused(content, tmp_path):
    path = tmp_path / "odd.json"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"odd\.json is not a baseline"):
        make_policy(str(path))


def test_a_tuned_baseline_is_refused_for_another_robot_or_rate(tuned):
    assert isinstance(make_policy(str(tuned)), BearingPolicy)
    assert isinstance(load_baseline(tuned), BearingPolicy)
    for options, wanted in (({"dt": 0.05}, "20 Hz burger"), ({"robot": "waffle"}, "10 Hz waffle")):
        with pytest.raises(ValueError, match=f"made for 10 Hz burger, asked for {wanted}"):
            make_policy(str(tuned), **options)


@pytest.mark.sample(4)
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": "turtlebot-gym-baseline/2"}, "is not a baseline"),
        ({"policy": "ppo"}, "policy must be one of"),
        ({"policy": None}, "policy must be one of"),
        ({"numbers": {"speed": 3.0}}, "has no speed"),
        ({"numbers": {"gain": "fast"}}, "is not a baseline"),
        ({"numbers": {"gain": None}}, "is not a baseline"),
        ({"numbers": {"gain": -1.0}}, "gain must be a positive number"),
        ({"numbers": {"gain": float("nan")}}, "gain must be a positive number"),
        ({"numbers": 3}, "is not a baseline"),
        ({"robot": {"name": "x"}}, "is not a baseline"),
        ({"robot": {"name": "x", "max_linear": -1.0, "max_angular": 1.0}}, "max_linear must be a number from 1e-15 to 100"),
        ({"robot": None}, "is not a baseline"),
        ({"dt": float("nan")}, "dt must be a positive number"),
        ({"dt": "0.1"}, "is not a baseline"),
    ],
)
def test_a_spoilt_file_is_refused_with_the_reason(change, message, tuned):
    tuned.write_text(json.dumps(json.loads(tuned.read_text()) | change))
    with pytest.raises(ValueError, match=message):
        make_policy(str(tuned))
