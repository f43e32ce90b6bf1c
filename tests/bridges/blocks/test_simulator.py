"""The plant is the environment: same transition, same noise for the same seed and episode."""

import numpy as np

from turtlebot_gym_ros.blocks import TurtlebotSimulator


def test_a_drawn_room_has_the_map_of_the_environments_localizer_anew_in_each_episode():
    node = TurtlebotSimulator(TurtlebotSimulator.Params(world="dense", noise="wheel", localizer="match", goals=2, seed=3))
    fields = []
    for _ in range(2):
        field = node.step(0.1, None)["map"].field()
        np.testing.assert_array_equal(field, node._episode.scene.memory.field)
        assert "map" not in node.step(0.1, None)
        fields.append(field)
        node.reset()
    assert (fields[0] != fields[1]).any()
