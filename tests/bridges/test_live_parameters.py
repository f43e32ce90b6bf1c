"""Gains, Q and R: from files, at the start, and while a node runs; whatever is wrong is refused and changes nothing."""

from dataclasses import replace

import numpy as np
import pytest
from rclpy.parameter import Parameter

from turtlebot_gym.parameters import FilterTuning
from turtlebot_gym.presets import make_filter, make_noise
from turtlebot_gym.values import Command, Odometry, Pose
from turtlebot_gym_ros import Shell
from turtlebot_gym_ros.blocks import KalmanFilter, VelocityController

NOISE = make_noise("tutorial")
NODES = {"controller": VelocityController, "filter": KalmanFilter}


@pytest.fixture
def node_of(runner):
    shells = []

    def make(kind, **given):
        shells.append(Shell(NODES[kind], NODES[kind].Params, context=runner.context, overrides=given))
        return shells[-1]

    yield make
    for shell in shells:
        shell.close()


def set_all(shell, **values):
    """Set parameters in one request, as ``ros2 param set`` does, and return the refusal, or an empty text."""
    parameters = [Parameter(name.replace("__", "."), value=value) for name, value in values.items()]
    result = shell.node.set_parameters_atomically(parameters)
    return "" if result.successful else result.reason


def test_gains_are_those_of_the_policy_and_can_be_set(node_of, tmp_path):
    (tmp_path / "mine.yaml").write_text("policy: proportional\nkv: 0.8\n")
    shell = node_of("controller", policy=str(tmp_path / "mine.yaml"), **{"gains.komega": 2})
    driver = shell.block.driver
    assert driver.gains == {"kv": 0.8, "komega": 2.0}
    assert shell.node.get_parameter("gains.kv").value == 0.8
    assert shell.node.describe_parameter("gains.kv").description == "Gain on the distance, 1/s."
    ahead = np.array([*driver.observation], np.float32)
    ahead[0] = 0.1  # so near that the speed is proportional to it
    before = driver.baseline(ahead)[0]
    assert set_all(shell, gains__kv=0.4) == ""
    assert driver.baseline(ahead)[0] == pytest.approx(before / 2)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"gains__kv": -1.0}, "kv must be a positive number"),
        ({"gains__kv": "high"}, "kv must be a positive number"),
        ({"gains__kv": 0.1, "gains__komega": float("nan")}, "komega must be a positive number"),
        ({"gains__kv": 0.1, "use_sim_time": True}, "gains.kv must be set without other parameters"),
        ({"policy": "bearing"}, "read-only"),
    ],
)
def test_a_wrong_gain_is_refused_and_changes_nothing(node_of, values, said):
    shell = node_of("controller", policy="proportional")
    assert said in set_all(shell, **values)
    assert shell.block.driver.gains == {"kv": 0.5, "komega": 1.5}


@pytest.mark.parametrize(
    ("kind", "given", "said"),
    [
        ("controller", {"policy": "proportional", "gains.gain": 2.0}, "'gains.gain': there are gains.kv, gains.komega"),
        ("controller", {"policy": "ppo-nav", "gains.kv": 2.0}, "'gains.kv': there is none to set here"),
        ("controller", {"policy": "bearing", "gains.gain": 0.0}, "gain must be a positive number"),
        ("filter", {"q": [0.1]}, "Q must be 5 numbers"),
        ("filter", {"r": [0.1, 0.1, -1.0]}, r"R\[2\] must be a number from 0"),
        ("filter", {"noise": "wheel", "r": [0.1, 0.1, 0.1]}, "no parameter 'r': there are q"),
    ],
)
def test_a_wrong_number_at_the_start_is_refused(node_of, kind, given, said):
    with pytest.raises(ValueError, match=said):
        node_of(kind, **given)


def steps(block, count):
    """Return the estimates of a drive ahead, of which the odometry is off by a constant."""
    for k in range(count):
        yield block.step(0.1, Odometry(Pose(0.02 * k, 0.1, 0.0), Command(0.2, 0.0), True))["estimate"].belief


def test_q_and_r_are_those_of_the_file_and_take_effect_at_the_next_step(node_of, tmp_path):
    Q, R = [0.01, 0.01, 0.02, 0.1, 0.1], [0.05, 0.05, 0.1]
    (tmp_path / "mine.yaml").write_text(f"Q: {Q}\nR: {R}\n")
    shell = node_of("filter", filter=str(tmp_path / "mine.yaml"), r=[1, 1, 1])
    assert list(shell.node.get_parameter("q").value) == Q
    block, same = shell.block, KalmanFilter(KalmanFilter.Params(filter=str(tmp_path / "mine.yaml")))
    same._tuning = FilterTuning(Q=Q, R=(1.0, 1.0, 1.0))
    assert list(steps(block, 5)) == list(steps(same, 5))
    assert set_all(shell, q=[0.0, 0.0, 0.0, 1e-4, 1e-4], r=[0.5, 0.5, 0.5]) == ""
    same._tuning = replace(same._tuning, Q=(0.0, 0.0, 0.0, 1e-4, 1e-4), R=(0.5, 0.5, 0.5))
    after = list(steps(block, 5))
    assert after == list(steps(same, 5))
    assert "R must be 3 numbers" in set_all(shell, q=[0.1] * 5, r=[0.1])
    assert block._tuning.Q == (0.0, 0.0, 0.0, 1e-4, 1e-4)


def test_an_object_of_filterpy_has_its_own_q(node_of, tmp_path, monkeypatch):
    pytest.importorskip("filterpy")
    (tmp_path / "own_filterpy.py").write_text(
        "import numpy as np\nfrom filterpy.kalman import ExtendedKalmanFilter\n"
        "mine = ExtendedKalmanFilter(5, 3)\nmine.Q *= 0.01\nmine.R *= 0.04\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    shell = node_of("filter", filter="own_filterpy:mine")
    assert not shell.node.has_parameter("q")
    assert list(shell.node.get_parameter("r").value) == [0.04] * 3
    first = list(steps(shell.block, 5))
    assert first[-1].mean.y == pytest.approx(0.1, abs=0.02)
    assert make_filter("own_filterpy:mine", NOISE).R == (0.04, 0.04, 0.04)
