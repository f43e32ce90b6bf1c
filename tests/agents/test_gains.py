"""Files of baselines with numbers of one's own: they drive as the class does, and the rest is refused in one line."""

import re

import numpy as np
import pytest

from turtlebot_gym.observations import OPEN_GROUND, size_of
from turtlebot_gym_agents import Deployment, ProportionalPolicy
from turtlebot_gym_agents.evaluation.evaluate import evaluate
from turtlebot_gym_agents.policies.baselines import POLICIES, default_numbers
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


@pytest.mark.parametrize("name", POLICIES)
def test_each_baseline_takes_its_numbers_by_file_and_by_tune(name, tmp_path):
    numbers = {key: value * 1.01 for key, value in default_numbers(name).items()}
    text = "".join(f"{key}: {value!r}\n" for key, value in numbers.items())
    by_file, tuned = make_policy(write(tmp_path, f"policy: {name}\n{text}")), Deployment(name)
    tuned.tune(numbers)
    assert by_file.numbers == tuned.gains == numbers
    for key, value in vars(by_file).items():  # what it computed from them, too
        if key.startswith("_") and isinstance(value, np.ndarray) and "memory" not in key:
            np.testing.assert_array_equal(np.shape(vars(tuned.baseline)[key]), np.shape(value))


def test_inside_of_the_safety_layer_it_is_tuned_too():
    deployment = Deployment("vfh+safety")
    name = next(iter(deployment.gains))
    deployment.tune({name: 0.9 * deployment.gains[name]})
    assert deployment._policy.policy.numbers == deployment.gains


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("kv: 0.8\n", "it must have the policy's name, such as policy: proportional"),
        ("policy: proportionl\n", "Did you mean 'proportional'"),
        ("policy: proportional\ngain: 3\n", "ProportionalPolicy has no gain"),
        ("policy: proportional\nkv: -1\n", "kv must be a positive number"),
        ("policy: proportional\ndt: 0.05\n", "dt must be left out"),
        ("- 1\n", "it must have the policy's name"),
        ("policy: [\n", "is not YAML"),
    ],
)
def test_what_a_file_cannot_say_is_refused(text, said, tmp_path):
    with pytest.raises(ValueError, match=re.escape(said)) as caught:
        make_policy(write(tmp_path, text))
    assert str(caught.value).startswith(str(tmp_path))
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_named():
    with pytest.raises(ValueError, match=r"There is no policy file 'nosuch\.yaml'"):
        make_policy("nosuch.yaml")


def test_other_policies_have_no_gains():
    deployment = Deployment("ppo-nav")
    with pytest.raises(ValueError, match="the policy has no gains"):
        deployment.tune({"kv": 1.0})
