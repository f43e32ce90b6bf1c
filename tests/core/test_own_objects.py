"""Terms and filters of one's own as Python objects stand for their names."""

import gymnasium as gym
import numpy as np
import own_parts
import own_terms
import pytest

from turtlebot_gym import ObservationTerm, RewardTerm
from turtlebot_gym.files import load_object, source_of
from turtlebot_gym.kernel import kernel
from turtlebot_gym.observations import GOAL
from turtlebot_gym.observations.reading import read_items
from turtlebot_gym.systems import Options

ID = "turtlebot_gym/TurtleBotNav-v0"
SPEEDOMETER, SPIN = own_terms.SPEEDOMETER, own_parts.SPIN
FILTER = own_parts.Extended  # in plain Python: nothing is compiled


def told(**options):
    """Return what an environment with some options tells in a few steps."""
    env = gym.make(ID, filter=FILTER, **options)
    observation, _ = env.reset(seed=3)
    rows = [observation.tolist()]
    for turn in (0.2, -0.5, 1.0):
        observation, reward, *_ = env.step(np.array([0.5, turn], np.float32))
        rows.append([*observation.tolist(), reward])
    return rows


@pytest.mark.parametrize(
    ("given", "names"),
    [
        ({"observation": ("ekf", SPEEDOMETER)}, {"observation": "ekf,own_terms:SPEEDOMETER"}),
        ({"observation": ["goal", SPEEDOMETER.over(2)]}, {"observation": "goal,own_terms:SPEEDOMETER*2"}),
        ({"observation": SPEEDOMETER}, {"observation": "own_terms:SPEEDOMETER"}),
        ({"reward": {SPIN: 7.0, "effort": 0.2}}, {"reward": {"own_parts:SPIN": 7.0, "effort": 0.2}}),
    ],
)
def test_an_object_is_what_its_name_is(given, names):
    assert told(**given) == told(**names)
    assert told(**given) != told()


def test_the_packages_own_terms_have_their_short_names():
    assert read_items([GOAL, GOAL.over(2, every=3)])[1] == ("goal", "goal*2@3")


def test_a_name_finds_the_object_again():
    source = source_of(SPEEDOMETER, "own_terms")
    assert source == "own_terms:SPEEDOMETER"
    assert load_object(source) is SPEEDOMETER
    assert source_of(SPEEDOMETER, "no_such_module", "own_parts") == ""


def test_a_term_without_a_name_at_the_top_of_its_module_is_refused():
    term = ObservationTerm("hidden", kernel(lambda world, p: 0.0), -1.0, 1.0)
    with pytest.raises(ValueError, match=r"the term 'hidden' must be at the top level of its module"):
        Options(observation=("ekf", term)).setup()


def test_a_reward_needs_no_name_and_none_twice():
    hidden = RewardTerm("hidden", own_parts.spin, 1.0)
    setup = Options(reward={hidden: 2.0}).setup()
    assert setup.parameters.reward[-1] == 2.0
    assert hidden.spelled == "hidden"
    with pytest.raises(ValueError, match="the reward has a term 'spin' already"):
        Options(reward={SPIN: 1.0, SPIN._replace(weight=3.0): 1.0}).setup()


def test_an_object_of_another_kind_is_refused():
    with pytest.raises(ValueError, match="observation must be names of terms"):
        Options(observation=("ekf", SPIN)).setup()
    with pytest.raises(ValueError, match="reward must be weights by name"):
        Options(reward={SPEEDOMETER: 1.0}).setup()
