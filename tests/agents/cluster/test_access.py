"""Where the work is done: what is refused before Ray is asked, and that nothing of Ray is needed without a cluster."""

import json
import socket
import subprocess
import sys
import threading

import pytest

pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")

from turtlebot_gym_agents.cluster import access, origin, ray_workers
from turtlebot_gym_agents.commands.cli import main

SHORT = ["evaluate", "--policy", "bearing", "--episodes", "20"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--workers", "2"], "workers is an option of a cluster: add --cluster local."),
        (["--cluster", "auto", "--workers", "2"], "workers is for the cluster 'local', not for 'auto'"),
        (["--cluster", "local", "--workers", "0"], "workers must be positive, got 0."),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(options, message, capsys):
    assert main([*SHORT, *options]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert message in line


def test_without_ray_the_command_says_what_to_install(monkeypatch, capsys):
    monkeypatch.setattr(ray_workers, "find_spec", lambda name: None)
    assert main([*SHORT, "--cluster", "local"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line == "turtlebot-gym: Clusters need Ray: pip install 'turtlebot-gym[cluster]'."


def test_nothing_of_ray_is_imported_without_a_cluster(tmp_path):
    script = (
        "import sys; from turtlebot_gym_agents.commands.cli import main; import turtlebot_gym_agents.cluster.ray_workers;"
        f"main({[*SHORT, '--store', str(tmp_path)]!r}); sys.exit('ray' in sys.modules)"
    )
    subprocess.run([sys.executable, "-c", script], check=True, capture_output=True)


def test_a_store_alone_changes_no_file(tmp_path):
    paths = tmp_path / "plain.json", tmp_path / "stored.json", tmp_path / "again.json"
    assert main([*SHORT, "--json", str(paths[0])]) == 0
    for path in paths[1:]:
        assert main([*SHORT, "--store", str(tmp_path / "store"), "--json", str(path)]) == 0
    assert paths[0].read_bytes() == paths[1].read_bytes() == paths[2].read_bytes()
    assert len([*(tmp_path / "store").iterdir()]) == 1


@pytest.mark.parametrize("address", ["everywhere", ":6379", "host:", "ray://10.0.0.1:10001", "host:port"])
def test_what_is_no_address_is_refused(address):
    with pytest.raises(ValueError, match=r"cluster must be 'local', 'auto' or HOST:PORT"):
        access.probe(address)


def answering(answer):
    """Return the address of something that gives one answer to whoever comes."""
    server = socket.create_server(("127.0.0.1", 0))

    def serve():
        connection, _ = server.accept()
        with connection, server:
            connection.recv(64)
            connection.sendall(answer)

    threading.Thread(target=serve, daemon=True).start()
    return f"127.0.0.1:{server.getsockname()[1]}"


def test_what_is_no_ray_is_noticed_before_ray_is_asked():
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with pytest.raises(OSError, match=f"There is no cluster at 127.0.0.1:{port}: "):
        access.probe(f"127.0.0.1:{port}")
    with pytest.raises(OSError, match="the program that listens there is not Ray"):
        access.probe(answering(b"HTTP/1.1 400 Bad Request"))


def test_what_speaks_as_ray_but_cannot_be_asked_is_told(monkeypatch):
    settings = bytes((0, 0, 0, 4, 0, 0, 0, 0, 0))
    monkeypatch.setattr(access.script, "__file__", "-c")  # Python takes the address for its program
    with pytest.raises(OSError, match=r"The cluster '127.0.0.1:\d+' cannot be used: SyntaxError: "):
        access.probe(answering(settings))


def told(monkeypatch, **node):
    """Let the probe tell of a node."""
    here = {"host": "there", "cpus": 1, "memory": 1e9, "origin": origin.origin()}
    answer = json.dumps({"address": "10.0.0.1:6379", "nodes": [{**here, **node}]})
    monkeypatch.setattr(access, "_require_ray", lambda address: None)
    monkeypatch.setattr(access.script, "__file__", "-c")
    return lambda: access.probe(f"print({answer!r})")


def test_a_node_that_would_come_to_other_results_is_told(monkeypatch):
    here = origin.origin()
    address, (node,) = told(monkeypatch)()
    assert address == "10.0.0.1:6379"
    assert node["memory"] == 1e9
    other = {**here["libraries"], "numpy": "1.0"}
    for change, message in (
        ({"origin": None}, "The node there of the cluster does not answer."),
        ({"origin": {"missing": "turtlebot_gym_agents"}}, "lacks the module turtlebot_gym_agents: install turtlebot-gym"),
        ({"origin": {**here, "version": "9"}}, "has turtlebot_gym 9, here it is"),
        ({"origin": {**here, "libraries": other}}, "has numpy 1.0, here it is"),
        ({"origin": {**here, "libraries": {}}}, "has no python, here it is"),
        ({"origin": {**here, "code": "0"}}, "has turtlebot_gym with other code than here: results could differ."),
    ):
        with pytest.raises(OSError, match=message):
            told(monkeypatch, **change)()


@pytest.mark.parametrize(
    ("text", "cluster", "reason"),
    [
        ("[x] W gcs_client.cc Unauthenticated: InvalidAuthToken\nConnectionError: no", "a:1", "it asks for a token"),
        ("Traceback:\n  File x\nConnectionError: Could not find any", "auto", "Ray is not running on this machine"),
        ("Traceback:\n  File x\nRuntimeError: Version mismatch\nmore", "a:1", "RuntimeError: Version mismatch"),
        ("", "a:1", "Ray ended without a message."),
    ],
)
def test_the_reason_is_one_line(text, cluster, reason):
    assert access._reason(text, cluster).startswith(reason)


def test_too_little_memory_is_told():
    with pytest.raises(OSError, match="a worker needs 524 MB, and its largest node gives 100 MB"):
        ray_workers._require_memory("local", 1e8, 500 * 2**20)
