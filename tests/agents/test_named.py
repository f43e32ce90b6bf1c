"""Policies by name: those of the package, of a file with numbers of one's own, and of a user's module."""

import re

import numpy as np
import pytest

from turtlebot_gym.observations import OPEN_GROUND, ROOM
from turtlebot_gym.observations.columns import size_of
from turtlebot_gym_agents import ProportionalPolicy, make_policy
from turtlebot_gym_agents.evaluation.evaluate import evaluate
from turtlebot_gym_agents.policies import PolicyWithMemory, terms_of
from turtlebot_gym_agents.policies.bundle import BundlePolicy
from turtlebot_gym_agents.policies.fit import ROOMS
from turtlebot_gym_agents.policies.named import shipped_folder

SHIPPED = {
    "ppo-nav": "turtlebot_gym/TurtleBotNav-v0",
    "ppo-pose": "turtlebot_gym/TurtleBotPose-v0",
    "ppo-square": "turtlebot_gym/TurtleBotSquare-v0",
    "ppo-rooms": "turtlebot_gym/TurtleBotRooms-v0",
}
LOCATED = {"env": ROOMS, "world": "office", "noise": "wheel", "localizer": "match", "observation": "located"}


def test_a_policy_is_shown_the_terms_that_it_reads_and_a_bundle_only_those_of_its_training():
    assert evaluate(f"{__name__}:seeing", episodes=1, **LOCATED).summary()["success"].value == 0.0
    with pytest.raises(ValueError, match=r"observation 'ekf', asked for .* 'located'"):
        evaluate("ppo-rooms", episodes=1, **LOCATED)


def seeing(observations):
    """Stand, by 50 numbers."""
    assert observations.shape[-1] == 50
    return np.zeros((*observations.shape[:-1], 2), np.float32)


seeing.terms = ROOM


@pytest.mark.parametrize("name", sorted(path.stem for path in shipped_folder("pretrained").glob("*.onnx")))
def test_the_shipped_policies_have_their_names_and_tasks_and_are_made_for_their_robot_and_period(name):
    policy = make_policy(name)
    assert isinstance(policy, BundlePolicy)
    assert (policy.card.env, policy.card.robot["name"], policy.card.dt) == (SHIPPED[name], "burger", 0.1)
    assert policy(np.zeros(size_of(policy.terms), np.float32)).shape == (2,)
    for reference in (name, str(shipped_folder("pretrained") / f"{name}.onnx")):
        assert make_policy(reference).sha256 == policy.sha256
        for options, wanted in (({"robot": "waffle"}, "10 Hz waffle"), ({"dt": 0.25}, "4 Hz burger")):
            with pytest.raises(ValueError, match=f"made for 10 Hz burger, asked for {wanted}"):
                make_policy(reference, **options)


@pytest.mark.parametrize(
    ("policy", "options", "message"),
    [
        ("ppo-square", {"env": "nav"}, "ppo-square: made for turtlebot_gym/TurtleBotSquare-v0 and observation 'ekf'"),
        ("ppo-nav", {"env": "nav", "observation": "odometry"}, "asked for turtlebot_gym/TurtleBotNav-v0 and 'odometry'"),
        ("ppo-nav", {"env": "nav", "dt": 0.05}, "made for 10 Hz burger, asked for 20 Hz burger"),
    ],
)
def test_a_bundle_for_another_setting_drives_only_if_it_may(policy, options, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        evaluate(policy, episodes=4, **options)
    assert len(evaluate(policy, episodes=4, allow_mismatch=True, **options).episodes.seed) == 4


# Files of baselines with numbers of one's own.


def write(folder, text):
    path = folder / "mine.yaml"
    path.write_text(text)
    return str(path)


def test_a_file_drives_as_the_class_does(tmp_path):
    path = write(tmp_path, "policy: proportional\nkv: 1\nkomega: 3.0\n")
    seen = np.random.default_rng(0).uniform(-1.0, 1.0, (50, size_of(OPEN_GROUND))).astype(np.float32)
    np.testing.assert_array_equal(make_policy(path)(seen), ProportionalPolicy("burger", kv=1.0, komega=3.0)(seen))
    options = {"env": "turtlebot_gym/TurtleBotSquare-v0", "episodes": 2}
    by_file, by_class = (evaluate(policy, **options).summary() for policy in (path, ProportionalPolicy(kv=1.0, komega=3.0)))
    assert by_file == by_class


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("kv: 0.8\n", "it must have the policy's name, such as policy: proportional"),
        ("policy: proportionl\n", "Did you mean 'proportional'"),
        ("policy: proportional\ngain: 3\n", "ProportionalPolicy has no gain"),
        ("policy: proportional\ndt: 0.05\n", "dt must be left out"),
        ("policy: [\n", "is not YAML"),
    ],
)
def test_what_a_file_cannot_say_is_refused(text, said, tmp_path):
    with pytest.raises(ValueError, match=re.escape(said)) as caught:
        make_policy(write(tmp_path, text))
    assert str(caught.value).startswith(str(tmp_path))
    assert "\n" not in str(caught.value)


# A user's policy.

POLICIES = """\
import numpy as np

def still(observations):
    return np.zeros((*observations.shape[:-1], 2), np.float32)

def raises(observations):
    return 1 / 0

def nan(observations):
    return np.full((*observations.shape[:-1], 2), np.nan)

def narrow(observations):
    return observations[..., :1]

def text(observations):
    return "left"

class Unmade:
    def __init__(self):
        pass

"""


@pytest.fixture
def own(tmp_path, monkeypatch):
    (tmp_path / "drivers.py").write_text(POLICIES)
    (tmp_path / "slips.py").write_text("import numpy as np\n\ndef policy(observations:\n    return 0\n")
    (tmp_path / "falls.py").write_text("import math\nprepared = math.sqrt(-1.0)\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)


def test_a_users_function_drives(own):
    policy = make_policy("drivers:still")
    for shape in ((13,), (4, 13), (2, 3, 13)):
        assert policy(np.zeros(shape, np.float32)).shape == (*shape[:-1], 2)
    assert not isinstance(policy, PolicyWithMemory)
    assert terms_of(policy) is None


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("slips:policy", r"SyntaxError: .* \(.*slips\.py, line 3\)"),
        ("falls:policy", r"ValueError: math domain error \(.*falls\.py, line 2\)"),
        ("drivers:Unmade", "TypeError: .*unexpected keyword argument"),
        ("drivers:raises", r"ZeroDivisionError: division by zero \(.*drivers\.py, line 7\)"),
        ("drivers:nan", "it must return finite numbers, got nan"),
        ("drivers:narrow", r"it must return an array of shape \(5, 2\), got \(5, 1\)"),
        ("drivers:text", "it must return numbers, got str"),
    ],
)
def test_a_failing_policy_is_reported_with_its_place_on_one_line(name, message, own):
    with pytest.raises(ValueError, match=rf"^[^\n]*{name}: {message}[^\n]*$"):
        make_policy(name)(np.zeros((5, 13), np.float32))
