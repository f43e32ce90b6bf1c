"""A user's policy: it drives like any other, and if it fails, the error names file and line."""

import numpy as np
import pytest

from turtlebot_gym_agents import make_policy
from turtlebot_gym_agents.policies import PolicyWithMemory, terms_of

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


@pytest.fixture(autouse=True)
def own(tmp_path, monkeypatch):
    (tmp_path / "drivers.py").write_text(POLICIES)
    (tmp_path / "slips.py").write_text("import numpy as np\n\ndef policy(observations:\n    return 0\n")
    (tmp_path / "falls.py").write_text("import math\nprepared = math.sqrt(-1.0)\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_users_function_drives():
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
def test_a_failing_policy_is_reported_with_its_place_on_one_line(name, message):
    with pytest.raises(ValueError, match=rf"^[^\n]*{name}: {message}[^\n]*$"):
        make_policy(name)(np.zeros((5, 13), np.float32))
