"""Networks of other libraries: the bundle does what the network does, or it is not written."""

import numpy as np
import torch
from torch import nn

from turtlebot_gym import make_noise
from turtlebot_gym.observations import OPEN_GROUND, ROOM
from turtlebot_gym.observations.columns import bounds_of
from turtlebot_gym_agents.policies.bundle import BundlePolicy
from turtlebot_gym_agents.training.export import export
from turtlebot_gym_agents.training.network import TOLERANCE

NAV, ROOMS = "turtlebot_gym/TurtleBotNav-v0", "turtlebot_gym/TurtleBotRooms-v0"


def mlp(inputs=13, outputs=2, scale=1.0):
    torch.manual_seed(0)
    network = nn.Sequential(nn.Linear(inputs, 16), nn.Tanh(), nn.Dropout(0.5), nn.Linear(16, outputs))
    network[-1].weight.data *= scale
    return network


def test_the_bundle_does_what_the_network_does(tmp_path):
    network, path = mlp(scale=10.0), tmp_path / "new" / "nav.onnx"
    options = {"robot": "waffle", "noise": "rough", "dt": 0.05}
    assert export(network, path, env=NAV, training={"library": "own"}, steps=100, **options).difference <= TOLERANCE
    policy = BundlePolicy(path)
    observations = np.random.default_rng(5).uniform(*bounds_of(OPEN_GROUND), (500, 13)).astype(np.float32)
    with torch.no_grad():
        free = network(torch.from_numpy(observations)).numpy()  # in evaluation mode, where nothing drops out
    assert (np.abs(free) > 1.0).any()
    np.testing.assert_allclose(policy(observations), np.clip(free, -1.0, 1.0), rtol=0, atol=TOLERANCE)
    card = policy.card
    assert (card.env, card.dt, card.noise, card.filter, card.observation) == (NAV, 0.05, "rough", "matched", "ekf")
    assert (card.robot["name"], policy.terms, card.training) == ("waffle", OPEN_GROUND, {"library": "own"})
    assert [file.name for file in path.parent.iterdir()] == ["nav.onnx"]


def test_a_network_for_rooms_takes_their_observations(tmp_path):
    export(mlp(50), tmp_path / "rooms.onnx", env=ROOMS, steps=20, noise=make_noise("rough"), world="dense")
    policy = BundlePolicy(tmp_path / "rooms.onnx")
    assert (policy.terms, policy.card.noise) == (ROOM, "custom")
    assert policy(np.zeros((3, 50))).shape == (3, 2)
