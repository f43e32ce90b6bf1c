"""Environments on a GPU have the bits of the engine: their kernels on this processor, and on a GPU where there is one."""

import math
import re
import sys

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import InvalidAction, ResetNeeded
from steering import SHAKY, drive

import turtlebot_gym  # noqa: F401  # registers the ids
from turtlebot_gym import RewardTerm
from turtlebot_gym.envs import navigation_device
from turtlebot_gym.envs.navigation_device import CHECKED, NavigationDeviceEnv
from turtlebot_gym.envs.navigation_vector import NavigationVectorEnv
from turtlebot_gym.envs.vector import make_vector

torch = pytest.importorskip("torch")

SQUARE = {"task": "square", "noise": "documented", "filter": "tutorial", "switch": "time", "robot": "tutorial"}
SYSTEMS = {
    "default": {"task": "nav"},
    "tutorial": SQUARE,
    "wheel": {"task": "pose", "noise": "wheel", "robot": "turtlebot4", "dt": 0.2, "delay": 2},
    "pose": {"task": "pose", "noise": SHAKY, "integrator": "midpoint", "arrival": "belief"},
    "gated": {"task": "nav", "noise": SHAKY, "filter": "gated"},
    "fixes": {"task": "nav", "noise": "wheel", "fix": "late"},
    "gyro": {"task": "square", "laps": 2, "noise": "rough", "filter": "gyro", "imu": "mpu9250", "fix": "beacons"},
}


@pytest.fixture(params=["torch-cpu", "cuda"])
def device(request):
    """Return the name of a device that is there."""
    if request.param == "cuda" and not torch.cuda.is_available():
        pytest.skip("there is no CUDA device")
    return request.param


def bits(value):
    """Return the bits of an array or a tensor, rows first."""
    array = np.ascontiguousarray(value if isinstance(value, np.ndarray) else value.cpu().numpy())
    return array.reshape(len(array), -1).view(np.uint8)


def same_rows(ours, theirs):
    """Return for each environment whether all arrays have the bits of all tensors."""
    return np.logical_and.reduce([(bits(one) == bits(other)).all(axis=1) for one, other in zip(ours, theirs, strict=True)])


def results_of(step):
    """Return all that a step says of each environment; where an episode has ended, also what was last."""
    observations, rewards, terminated, truncated, info = step
    found = [observations, rewards, terminated, truncated, info["distance"], info["is_success"]]
    if "_final_obs" in info:
        ended = info["_final_obs"]
        last = info["final_obs"]
        if isinstance(last, np.ndarray):  # of objects
            last = np.stack([np.zeros_like(observations[0]) if row is None else row for row in last])
        else:
            last = last.masked_fill(~ended[:, None], 0.0)
        found += [ended, last, info["final_info"]["distance"], info["final_info"]["is_success"]]
    return found


def ends_of(engine, other):
    """Return how many episodes ended in 200 steps, each with the bits of the engine."""
    rng, ends = np.random.default_rng(0), 0
    observations, info = engine.reset(seed=0)
    theirs, their_info = other.reset(seed=0)
    assert same_rows([observations, info["distance"]], [theirs, their_info["distance"]]).all()
    for _ in range(200):
        actions = drive(observations, rng).astype(np.float32)
        one, two = engine.step(actions), other.step(torch.as_tensor(actions, device=other.device))
        if "final_obs" not in one[4]:
            assert not bool(two[4].get("_final_obs", torch.zeros(1)).any())
            two = (*two[:4], {key: two[4][key] for key in ("distance", "is_success")})
        assert same_rows(results_of(one), results_of(two)).all()
        ends += np.count_nonzero(one[2] | one[3])
        observations = one[0]
    return ends


def pair(device, name, rows, **options):
    """Return environments of the engine and of a device."""
    options = {"max_episode_steps": 60} | SYSTEMS[name] | options
    return NavigationVectorEnv(rows, **options), NavigationDeviceEnv(rows, device=device, **options)


@pytest.mark.parametrize(("name", "mode"), [("default", "NextStep"), ("tutorial", "SameStep")])
def test_a_device_has_the_bits_of_the_engine(device, name, mode):
    assert ends_of(*pair(device, name, 50, autoreset_mode=mode)) > 100, "few episodes ended: the test saw too little"


@pytest.mark.slow
@pytest.mark.parametrize("name", SYSTEMS)
def test_each_system_has_the_bits_of_the_engine_for_200000_steps(device, name):
    assert ends_of(*pair(device, name, 1000, autoreset_mode="SameStep")) > 1000


def test_masks_and_seeds_begin_the_episodes_of_the_engine(device):
    engine, other = pair(device, "default", 6)
    mask = np.array([True, False, True, False, False, True])
    seeds = [None, 7, 2**80 + 5, None, 1, 0]
    for seed, chosen in ((3, None), (None, None), (None, mask), (seeds, None), (seeds, mask), ([9] * 6, ~mask)):
        options = None if chosen is None else {"reset_mask": chosen}
        theirs = None if chosen is None else {"reset_mask": torch.as_tensor(chosen, device=other.device)}
        one, two = engine.reset(seed=seed, options=options), other.reset(seed=seed, options=theirs)
        keys = "distance", "is_success", "_distance", "_is_success"
        assert same_rows([one[0], *(one[1][key] for key in keys)], [two[0], *(two[1][key] for key in keys)]).all()
        for _ in range(70):  # beyond the end of an episode
            actions = drive(one[0], np.random.default_rng(0)).astype(np.float32)
            one, two = engine.step(actions), other.step(torch.as_tensor(actions, device=other.device))
            assert same_rows(results_of(one), results_of(two)).all()


def test_everything_is_a_new_tensor_on_the_device(device):
    env = gym.make_vec("turtlebot_gym/TurtleBotNav-v0", num_envs=3, device=device, autoreset_mode="SameStep")
    assert isinstance(env, NavigationDeviceEnv)
    observations, _ = env.reset(seed=0)
    kept = observations.clone()
    results = env.step(torch.zeros((3, 2), dtype=torch.float64, device=env.device))
    tensors = [*results[:4], *(value for value in results[4].values() if not isinstance(value, dict))]
    assert {(tensor.device, len(tensor)) for tensor in [observations, *tensors]} == {(env.device, 3)}
    kinds = [tensor.dtype for tensor in results[:4]]
    assert kinds == [torch.float32, torch.float64, torch.bool, torch.bool]
    assert torch.equal(observations, kept)
    assert env.observation_space.contains(observations.cpu().numpy())


def test_actions_must_be_a_tensor_of_the_device():
    env = NavigationDeviceEnv(3, device="torch-cpu")
    good = torch.zeros((3, 2))
    with pytest.raises(ResetNeeded):
        env.step(good)
    env.reset(seed=0)
    for bad in (np.zeros((3, 2), np.float32), torch.zeros((2, 2)), torch.zeros((3, 2), device="meta"), [[0.0, 0.0]] * 3):
        with pytest.raises(InvalidAction, match=r"tensor of shape \(3, 2\) on cpu, got"):
            env.step(bad)
    env.step(good.requires_grad_().T.contiguous().T)  # in another order of memory


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_an_action_that_is_not_finite_is_an_error_soon(bad):
    env = NavigationDeviceEnv(3, device="torch-cpu")
    env.reset(seed=0)
    actions = torch.zeros((3, 2))
    actions[1, 1] = bad
    env.step(actions)
    for _ in range(CHECKED - 2):
        env.step(torch.zeros((3, 2)))
    with pytest.raises(InvalidAction, match="Environment 1: an action of the last 100 steps was not finite"):
        env.step(torch.zeros((3, 2)))
    env.step(actions)
    with pytest.raises(InvalidAction, match="Environment 1"):
        env.reset()
    env.reset()  # once is enough


def test_masks_are_checked():
    env = NavigationDeviceEnv(2, device="torch-cpu")
    some = torch.tensor([True, False])
    with pytest.raises(ResetNeeded, match="Environment 1"):
        env.reset(options={"reset_mask": some})
    env.reset(seed=0)
    for mask in (np.array([True, False]), torch.zeros(2, dtype=torch.bool), torch.ones(2), torch.ones(3, dtype=torch.bool)):
        with pytest.raises(ValueError, match="reset_mask must be"):
            env.reset(options={"reset_mask": mask})
    with pytest.raises(ValueError, match="options must be among 'reset_mask', got 'start'"):
        env.reset(options={"start": (0.0, 0.0)})


REFUSED = {
    "rooms": {"task": "room"},
    "a filter in plain Python": {"filter": "own_parts:Extended"},
    "an observation of past values": {"observation": "ekf,twist*2"},
    "info='full'": {"info": "full"},
    "render_mode='rgb_array'": {"render_mode": "rgb_array"},
    "autoreset_mode='Disabled'": {"autoreset_mode": "Disabled"},
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_a_device_cannot_do_is_refused_before_anything_is_compiled(what, monkeypatch):
    monkeypatch.setattr(navigation_device, "DeviceBatch", lambda *args, **options: pytest.fail("compiled"))
    with pytest.raises(ValueError, match=f"device='torch-cpu' cannot do {re.escape(what)}: leave device out"):
        NavigationDeviceEnv(2, device="torch-cpu", **REFUSED[what])


def test_a_kernel_that_calls_the_library_is_refused():
    swing = RewardTerm("swing", lambda before, after, judgement, p: math.sin(after.steps), 1.0)
    with pytest.raises(ValueError, match=r"a kernel calls math\.sin, whose last bits differ.* Leave device out"):
        NavigationDeviceEnv(2, device="torch-cpu", reward={swing: 1.0})


def test_parameters_cannot_be_changed(device):
    env = NavigationDeviceEnv(2, device=device)
    with pytest.raises(ValueError, match="make another environment with them, or leave device out"):
        env.set_parameters(env.parameters)


@pytest.mark.parametrize("name", ["gpu", "cuda:", "", None, 0, "cuda:99"])
def test_an_unknown_or_missing_device_is_refused(name):
    with pytest.raises(ValueError, match=r"device must be 'cpu', 'cuda'|device='cuda:99' is not there"):
        make_vector(2, device=name)


def test_a_missing_torch_is_named_with_its_remedy(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(ImportError, match=r"device='cuda' needs torch: pip install torch"):
        make_vector(2, device="cuda")
