"""A ROS domain for each test process, so that its kernels and nodes receive no messages from others; hypothesis' profile.

Also the comparison of a batch with plain Python, files of maps, and programs in processes of their own.
"""

import gc
import json
import os
import socket
import subprocess
import sys

# Three test processes share the cores: threads of small products of matrices would only wait for each other.
os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}

import numpy as np
import pytest
from hypothesis import settings


def claim_domain():
    """Return a ROS domain unique among test processes on this machine, and an open port that reserves it."""
    for domain in (1 + (os.getpid() + k) % 100 for k in range(100)):
        claim = socket.socket()
        try:
            claim.bind(("127.0.0.1", 27000 + domain))
        except OSError:
            claim.close()
        else:
            return str(domain), claim
    raise RuntimeError("All ROS domains from 1 to 100 are claimed on this machine.")


os.environ["ROS_DOMAIN_ID"], _CLAIM = claim_domain()
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ.pop("COLUMNS", None)  # pytest-xdist sets it, and tables would be as wide as the terminal

# Every run tries the same examples, so that a failure comes from a change; others are tried with --hypothesis-profile=default.
settings.register_profile("same", derandomize=True, deadline=None)
settings.load_profile("same")


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Collect no garbage while modules and tests are made, which stay; nor look through them in each later collection."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        gc.freeze()


def _in_step(batch, plain, low=-1.0, high=1.0, steps=100, *, policy=None):
    from turtlebot_gym.compiled.values import numbers_of

    batch.seeds[:] = np.arange(batch.num_envs)
    observations, outcomes = batch.empty()
    batch.reset(np.ones(batch.num_envs, np.bool_), observations, outcomes)
    rng = np.random.default_rng(0)
    for step in range(steps + 1):
        for row, episode in plain.items():
            assert batch.world(row) == episode.world
            np.testing.assert_array_equal(observations[row], np.array(episode.observe(), np.float32))
        if step == steps:
            return
        drawn = rng.uniform(low, high, (batch.num_envs, 2)) if policy is None else policy(observations, rng)
        actions = drawn.astype(np.float32)
        observations, outcomes = batch.step(actions)
        assert (batch.flagged > 0) == outcomes[2:5].any()
        for row, episode in plain.items():
            assert outcomes[:, row].tolist() == numbers_of(episode.act(actions[row].tolist()))[: len(outcomes)]
        yield outcomes
        ended = outcomes[3:5].any(axis=0)
        if ended.any():
            batch.episodes[ended] += 1
            batch.reset(ended, observations, outcomes)
            for row in plain.keys() & np.flatnonzero(ended).tolist():
                plain[row].reset()


@pytest.fixture(scope="session")
def in_step():
    """Return a generator of a batch's outcomes; in each step, some rows must equal episodes in plain Python to the bit.

    Actions are drawn between two bounds, or by a policy from observations and a generator. Others follow an episode that ends.
    """
    return _in_step


EMPTY = np.pad(np.full((58, 58), 254, np.uint8), 1)
"""Pixels of an empty hall within walls."""


def _write_map(folder, pixels=EMPTY, *, image="map.pgm", **given):
    """Write a map, and return the path of its YAML file."""
    if isinstance(pixels, str):
        (folder / image).write_text(pixels)
    elif image.endswith(".pgm") and pixels.ndim == 2:  # by hand: P5
        (folder / image).write_bytes(b"P5\n# made here\n%d %d\n255\n" % pixels.shape[::-1] + pixels.tobytes())
    else:
        pytest.importorskip("PIL.Image").fromarray(pixels).save(folder / image)
    given = {
        "image": image,
        "resolution": 0.05,
        "origin": [0.0, 0.0, 0.0],
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
    } | given
    path = folder / "map.yaml"
    path.write_text("".join(f"{key}: {value}\n" for key, value in given.items() if value is not None))
    return path


@pytest.fixture(scope="session")
def write_map():
    """Return a function that writes a map, by default of an empty hall."""
    return _write_map


@pytest.fixture(scope="session")
def run():
    """Return a function that runs a program in a Python of its own, and returns what it prints last as JSON."""

    def run(program, *arguments, path=None, **environment):
        command = [sys.executable, "-W", "error", "-c", program, *map(str, arguments)]
        given = {key: str(value) for key, value in environment.items()} | ({"PYTHONPATH": str(path)} if path else {})
        done = subprocess.run(command, env=os.environ | given, capture_output=True, text=True, cwd=path, timeout=300)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout.splitlines()[-1])

    return run


def pytest_unconfigure():
    """Release the domain."""
    _CLAIM.close()
