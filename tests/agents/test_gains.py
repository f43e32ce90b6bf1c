"""Files of baselines with numbers of one's own: they drive as the class does, and the rest is refused in one line."""

import re

import numpy as np
import pytest

from turtlebot_gym.observations import OPEN_GROUND
from turtlebot_gym.observations.columns import size_of
from turtlebot_gym_agents import ProportionalPolicy
from turtlebot_gym_agents.evaluation.evaluate import evaluate
from turtlebot_gym_agents.policies.named import make_policy


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
