"""A pipe is no bundle, and results are replaced whole."""

import os
import resource

import matplotlib.pyplot as plt
import pytest
from bundles import CARD, linear_model

from turtlebot_gym_agents.commands.console import save_figure
from turtlebot_gym_agents.policies.bundle import BundlePolicy, write_bundle
from turtlebot_gym_agents.provenance import replace_json, write_json


def test_a_pipe_for_a_bundle_is_refused(tmp_path):
    os.mkfifo(tmp_path / "policy.onnx")
    with pytest.raises(ValueError, match="it is a pipe"):
        BundlePolicy(tmp_path / "policy.onnx")


WRITE = {
    "a.json": lambda path: write_json(path, {"numbers": list(range(100))}, config={}),
    "b.json": lambda path: replace_json(path, list(range(100))),
    "c.onnx": lambda path: write_bundle(path, linear_model(), CARD),
    "d.png": lambda path: save_figure(plt.figure(), path),
    "e.svg": lambda path: save_figure(plt.figure(), path),
}


@pytest.mark.parametrize("name", WRITE)
def test_a_full_disk_leaves_the_old_result(tmp_path, name):
    path = tmp_path / name
    WRITE[name](path)
    before, limit = path.read_bytes(), resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (64, limit[1]))
    try:
        with pytest.raises(OSError, match="File too large"):
            WRITE[name](path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    plt.close("all")
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
