"""The benchmark on the worlds of the BARN challenge: what is driven is kept, and a piece of it is like the whole."""

import json
import sys

import numpy as np
import pytest

from harness.study import run

pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")
barn = pytest.importorskip("barn")


@pytest.fixture
def archive(tmp_path):
    """Two worlds: one cylinder beside the way, and one upon it."""
    path = tmp_path / "worlds.npz"
    circles = np.array([[1.0, 2.0, 0.2], [0.0, 2.0, 0.2]])
    np.savez(path, circles=circles, count=np.array([1, 1]), start=np.array([0.0, 0.0, np.pi / 2]), goal=np.array([0.0, 4.0]))
    return path


def test_each_world_is_driven_once_and_kept(archive, tmp_path, monkeypatch):
    plans = barn.read(archive)
    config = barn.Config(worlds=archive, episodes=2, limit=400)
    first = barn.driven(tmp_path, "bearing", 0, plans, config)
    assert [world["success"] for world in first] == [1.0, 0.0]
    assert first[1]["collision"] == 1.0
    monkeypatch.setattr(barn, "figures", lambda *arguments: pytest.fail("driven again"))
    np.testing.assert_equal(barn.driven(tmp_path, "bearing", 0, plans, config), first)  # NaN is NaN
    with pytest.raises(pytest.fail.Exception):
        barn.driven(tmp_path, "bearing", 1, plans[1:], config)


def test_a_policy_is_added_to_earlier_results_with_the_commit_of_each(archive, tmp_path, monkeypatch, capsys):
    first, second = tmp_path / "first.json", tmp_path / "second.json"
    common = ["barn.py", str(archive), "--episodes", "1", "--limit", "400", "--runs", str(tmp_path)]
    monkeypatch.setattr(barn, "run_all", lambda jobs, *_: [job() for job in jobs])
    monkeypatch.setattr(barn, "provenance", lambda: {"commit": "a"})
    monkeypatch.setattr(sys, "argv", [*common, "--policy", "bearing", "--json", str(first)])
    run(barn.Config, barn.measure)
    monkeypatch.setattr(barn, "provenance", lambda: {"commit": "b"})
    monkeypatch.setattr(sys, "argv", [*common, "--policy", "vfh", "--add-to", str(first), "--json", str(second)])
    run(barn.Config, barn.measure)
    before, after = (json.loads(path.read_text()) for path in (first, second))
    assert after["config"] == {**before["config"], "policy": ["bearing", "vfh"]}
    assert after["commits"] == {"bearing": "a", "vfh": "b"}
    assert after["mean"]["bearing"] == before["mean"]["bearing"]
    assert [world["bearing"] for world in after["worlds"]] == [world["bearing"] for world in before["worlds"]]
    assert after["mean"]["vfh"]["collision"]["value"] == 0.0 < after["mean"]["bearing"]["collision"]["value"]
    monkeypatch.setattr(sys, "argv", [*common, "--policy", "vfh", "--noise", "rough", "--add-to", str(first)])
    with pytest.raises(ValueError, match="has other settings"):
        run(barn.Config, barn.measure)
