"""Our Adam is torch's, to the bit."""

import torch

from turtlebot_gym_agents.training.optimizer import Adam


def trained(kind, *, again=None):
    """Return a network's weights after some steps; with ``again``, through a saved state in the middle."""
    torch.manual_seed(0)
    network = torch.nn.Sequential(torch.nn.Linear(13, 64), torch.nn.ReLU(), torch.nn.Linear(64, 2))
    optimizer = kind(network.parameters(), lr=1e-3, eps=1e-5)
    for step in range(30):
        if again and step == 15:
            state, optimizer = optimizer.state_dict(), again(network.parameters(), lr=7.0)
            optimizer.load_state_dict(state)
        optimizer.zero_grad()
        network(torch.randn(32, 13)).square().sum().backward()
        optimizer.step()
    return torch.cat([weight.detach().flatten() for weight in network.parameters()])


def test_adams_steps_and_state_are_torchs():
    expected = trained(torch.optim.Adam)
    assert torch.equal(trained(Adam), expected)
    assert not torch.equal(expected, trained(torch.optim.AdamW))  # the comparison can fail
    for first, then in ((Adam, torch.optim.Adam), (torch.optim.Adam, Adam), (Adam, Adam)):
        assert torch.equal(trained(first, again=then), expected)
        assert torch.is_grad_enabled()
