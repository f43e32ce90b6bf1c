"""Policies of other libraries at a live node: it acts as the library does, with normalization, stack and state."""

import numpy as np
import pytest
from std_srvs.srv import Trigger

pytest.importorskip("sb3_contrib", reason="needs the extra [dev]")

from foreign import library_actions, trained

from turtlebot_gym_agents.training.export import export
from turtlebot_gym_agents.training.network import TOLERANCE
from turtlebot_gym_ros import Graph
from turtlebot_gym_ros.blocks import VelocityController

SQUARE = "turtlebot_gym/TurtleBotSquare-v0"


@pytest.mark.nightly
@pytest.mark.parametrize("kind", ["normalized", "stacked", "recurrent", "recurrent-normalized-stack"])
def test_a_live_node_acts_as_the_library_and_begins_anew_with_an_episode(tmp_path, peer, monkeypatch, kind):
    model = trained(kind, tmp_path, env=SQUARE)
    export(tmp_path / "model.zip", tmp_path / "policy.onnx", env=SQUARE, allow_pickle=True)
    seen, begins, starts = [], [], [True]
    step, reset = VelocityController.step, VelocityController.reset

    def noted_step(block, *args, **values):
        answer = step(block, *args, **values)
        seen.append((block.driver.observation.copy(), block.driver.action.copy()))
        begins.append(starts.pop() if starts else False)
        return answer

    def noted_reset(block):
        reset(block)
        starts[:] = [True]

    monkeypatch.setattr(VelocityController, "step", noted_step)
    monkeypatch.setattr(VelocityController, "reset", noted_reset)
    with Graph(policy=str(tmp_path / "policy.onnx"), seed=3, goal_tolerance=0.0, switch="time", speed=50.0) as graph:
        for _ in range(2):
            graph.wait_until(lambda graph: graph.time > 45.0, timeout=120.0)
            assert peer.ask("turtlebot_simulator/reset", Trigger, Trigger.Request()).success
            graph.wait_until(lambda graph: graph.time < 45.0)
        graph.wait_until(lambda graph: graph.time > 15.0, timeout=120.0)
    observations, actions = (np.array(part) for part in zip(*seen, strict=True))
    assert len(observations) >= 1000
    assert 3 <= sum(begins) <= 6
    np.testing.assert_allclose(actions, library_actions(model, observations, np.array(begins)), rtol=0, atol=TOLERANCE)
    # The comparison can fail: a memory that goes on over the episodes acts otherwise.
    if kind != "normalized":
        going_on = library_actions(model, observations, np.arange(len(begins)) == 0)
        assert np.abs(actions - going_on).max() > TOLERANCE
