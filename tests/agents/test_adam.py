"""Adam: the same updates as torch's, to the bit, without torch's compiler."""

import pytest
import torch

from turtlebot_gym_agents.training.adam import Adam


def trained(make, steps, state=None):
    """Return network and optimizer after updates, of which every third one leaves out a parameter."""
    torch.manual_seed(0)
    network = torch.nn.Sequential(torch.nn.Linear(5, 8), torch.nn.ReLU(), torch.nn.Linear(8, 2))
    optimizer = make(network.parameters(), lr=1e-2, eps=1e-5)
    if state is not None:
        optimizer.load_state_dict(state)
    for step in range(steps):
        optimizer.param_groups[0]["lr"] = 1e-2 / (1 + step)
        optimizer.zero_grad()
        network(torch.randn(16, 5)).square().mean().backward()
        if step % 3 == 0:
            network[0].weight.grad = None
        optimizer.step()
    return network, optimizer


def test_updates_are_those_of_torch_to_the_bit_also_from_its_state():
    theirs, state = trained(torch.optim.Adam, 20)[0], trained(torch.optim.Adam, 20)[1].state_dict()
    ours, optimizer = trained(Adam, 20)
    assert all(torch.equal(one, other) for one, other in zip(ours.parameters(), theirs.parameters(), strict=True))
    assert optimizer.state_dict()["state"].keys() == state["state"].keys()
    for number, part in optimizer.state_dict()["state"].items():
        assert all(torch.equal(value, state["state"][number][name]) for name, value in part.items())
    ours, theirs = (trained(make, 30, state)[0].parameters() for make in (Adam, torch.optim.Adam))
    assert all(torch.equal(one, other) for one, other in zip(ours, theirs, strict=True))


def test_the_state_of_other_parameters_is_refused():
    state = trained(Adam, 2)[1].state_dict()
    for shapes in ([(8, 5)], [(8, 4), (8,), (2, 8), (2,)]):
        with pytest.raises(ValueError, match="state is of other parameters"):
            Adam([torch.zeros(shape) for shape in shapes]).load_state_dict(state)
