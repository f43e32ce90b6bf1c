"""Peers: what they are asked for and answer, with stand-ins for the libraries; one that fails is left out, with the reason."""

import io
import json
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from harness import peer, peers
from harness.peers import Entry, Process

STAND_IN = """
import json, sys
print("a library says hello")
print("ready", json.dumps({"python": "3", "gymnax": "0"}), flush=True)
for line in sys.stdin:
    print("noise\\nturn", json.dumps([int(line) * 0.5, int(line) * 2.0]), flush=True)
    if int(line) > 99:
        sys.exit("it broke")
"""


def process(tmp_path, program=STAND_IN):
    return Process([sys.executable, "-I", "-c", program], tmp_path / "log.txt")


def test_a_peer_answers_each_turn_and_one_that_ends_says_why(tmp_path):
    stand_in = process(tmp_path)
    assert stand_in.versions == {"python": "3", "gymnax": "0"}
    assert [stand_in.turn(calls) for calls in (3, 100)] == [(1.5, 6.0), (50.0, 200.0)]
    with pytest.raises(ChildProcessError, match="ended with status 1: it broke"):
        stand_in.turn(1)
    stand_in.stop()
    with pytest.raises(ChildProcessError, match="ended with status 1: ModuleNotFoundError: No module named 'nothing_such'"):
        process(tmp_path, "import nothing_such")


def test_what_cannot_be_installed_is_left_out_with_the_reason(tmp_path, monkeypatch, capsys):
    (tmp_path / "gymnax" / "bin").mkdir(parents=True)

    def install(name, folder):
        if name == "envpool":
            raise ChildProcessError("there is no wheel")
        return tmp_path / "gymnax" / "bin" / "python"

    started = []
    monkeypatch.setattr(peers, "install", install)
    monkeypatch.setattr(peers, "Process", lambda command, log: started.append(process(tmp_path)) or started[-1])
    with peers.peers(tmp_path, (32, 64)) as present:
        assert [*present.contenders] == [
            "vector of 32, gymnax's CartPole-v1, lax.scan",
            "vector of 64, gymnax's CartPole-v1, lax.scan",
            "vector of 32, gymnax's CartPole-v1",
            "vector of 32, gymnax's Pendulum-v1, lax.scan",
            "vector of 32, gymnax's Pendulum-v1",
        ]
        assert present.versions == {"gymnax": {"python": "3", "gymnax": "0"}, "envpool": {"missing": "there is no wheel"}}
        scanned = present.contenders["vector of 64, gymnax's CartPole-v1, lax.scan"]
        assert (scanned.size, scanned.steps, scanned.base, scanned.by) == (64, 16, "vector of 64, CartPole-v1", "gymnax")
        assert scanned.run(2) == (1.0, 4.0)
    assert "Without EnvPool: there is no wheel" in capsys.readouterr().err
    entry = peers.entries("envpool", (4096, 65_536))[0]  # of another size: it is compared with the first one
    assert peers.entries("envpool", (1024,)) == [entry] == [Entry("CartPole-v1", 1024, "step")]
    other = peers.contender(SimpleNamespace(turn=None), "envpool", entry, (4096, 65_536))
    assert (other.size, other.steps, other.base) == (1024, 1, "vector of 4096, CartPole-v1")
    assert all(stand_in._process.returncode is not None for stand_in in started)


def test_an_environment_is_made_once_and_anew_for_other_versions_and_a_missing_wheel_is_said_plainly(tmp_path, monkeypatch):
    made, asked, answer = [], [], SimpleNamespace(returncode=0)

    def create(place, with_pip):
        made.append(place)
        (place / "bin").mkdir(parents=True, exist_ok=True)
        (place / "bin" / "python").touch()

    monkeypatch.setattr(peers.venv, "create", create)
    monkeypatch.setattr(peers.subprocess, "run", lambda command, **_: asked.append(command) or answer)
    for _ in range(2):
        python = peers.install("envpool", tmp_path)
    assert made == [python.parents[1]]
    assert asked[0][-3:] == ["--only-binary", ":all:", "envpool==1.2.5"]
    (python.parents[1] / "installed").write_text("envpool==0.1")
    assert peers.install("envpool", tmp_path) == python
    assert len(made) == 2
    answer = subprocess.CompletedProcess([], 1, "", "WARNING: x\nERROR: No matching distribution found for envpool==1.2.5\n")
    text = r"EnvPool cannot be installed for Python 3\.\d+ \(it has wheels for 3\.11 to 3\.14\): ERROR: No matching"
    with pytest.raises(ChildProcessError, match=text):
        peers.install("envpool", tmp_path / "other")


def test_the_program_makes_as_many_calls_as_it_is_asked_for(monkeypatch, capsys):
    made = []
    monkeypatch.setitem(
        peer.CALLS, "made up", (lambda env_id, size, form: made.append((env_id, size, form)) or made.append, ("numpy",))
    )
    monkeypatch.setattr(sys, "stdin", io.StringIO("3\n1\n"))
    peer.main("made up", "CartPole-v1", "8", "step")
    assert made == [("CartPole-v1", 8, "step"), 0, 0, 1, 2, 0]
    ready, *turns = capsys.readouterr().out.splitlines()
    assert json.loads(ready.removeprefix("ready"))["numpy"] == np.__version__
    assert [min(json.loads(turn.removeprefix("turn"))) >= 0.0 for turn in turns] == [True, True]


@pytest.mark.parametrize("discrete", [True, False])
def test_envpool_steps_all_environments_with_actions_in_range(monkeypatch, discrete):
    given, taken = {}, []
    box = SimpleNamespace(low=np.array([-2.0]), high=np.array([2.0]))
    envs = SimpleNamespace(action_space=SimpleNamespace(n=2) if discrete else box, reset=lambda: None, step=taken.append)
    monkeypatch.setitem(sys.modules, "envpool", SimpleNamespace(make=lambda env_id, **options: given.update(options) or envs))
    call = peer.envpool_calls("made up", 32, "step")
    for k in range(17):
        call(k)
    assert given == {"env_type": "gymnasium", "num_envs": 32}
    assert len(taken) == 17
    assert taken[0] is not taken[1]
    np.testing.assert_array_equal(taken[0], taken[16])
    actions, low, high = np.stack(taken), *((0, 1) if discrete else (-2.0, 2.0))
    assert actions.shape == ((17, 32) if discrete else (17, 32, 1))
    assert low <= actions.min() < low + 0.5 <= high - 0.5 < actions.max() <= high
    assert not discrete or {*np.unique(actions)} == {0, 1}
    with pytest.raises(ValueError, match="form must be 'step'"):
        peer.envpool_calls("made up", 32, "scan")
