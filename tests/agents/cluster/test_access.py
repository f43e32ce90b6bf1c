"""Where work runs: what is refused before it starts; without a cluster Ray is not needed."""

import re
import socket
import subprocess
import sys
import threading

import pytest

pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")

from turtlebot_gym.extras import installing
from turtlebot_gym_agents.cluster import workers as module
from turtlebot_gym_agents.cluster.drives import drives
from turtlebot_gym_agents.cluster.units import origin
from turtlebot_gym_agents.commands.cli import main

SHORT = ["evaluate", "--policy", "bearing", "--episodes", "20"]


def refused(*options, capsys):
    """Return the one-line error of a refused command."""
    assert main([*SHORT, *options]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    return line


@pytest.mark.parametrize(("cluster", "library", "extra"), [("local", "joblib", "agents"), ("auto", "ray", "cluster")])
def test_without_its_library_the_command_says_what_to_install(cluster, library, extra, monkeypatch, capsys):
    monkeypatch.setattr(module, "find_spec", lambda name: None)
    expected = f"turtlebot-gym: The cluster '{cluster}' needs {library}: {installing(extra)}."
    assert refused("--cluster", cluster, capsys=capsys) == expected


def test_nothing_of_ray_is_imported_without_a_cluster(tmp_path):
    script = (
        "import sys; from turtlebot_gym_agents.commands.cli import main; import turtlebot_gym_agents.cluster.workers;"
        f"main({[*SHORT, '--store', str(tmp_path)]!r}); sys.exit('ray' in sys.modules or 'joblib' in sys.modules)"
    )
    subprocess.run([sys.executable, "-c", script], check=True, capture_output=True)


def test_a_store_alone_changes_no_file(tmp_path):
    paths = tmp_path / "plain.json", tmp_path / "stored.json", tmp_path / "again.json"
    assert main([*SHORT, "--json", str(paths[0])]) == 0
    for path in paths[1:]:
        assert main([*SHORT, "--store", str(tmp_path / "store"), "--json", str(path)]) == 0
    assert paths[0].read_bytes() == paths[1].read_bytes() == paths[2].read_bytes()
    assert len([*(tmp_path / "store").iterdir()]) == 1


NO_ADDRESSES = ("everywhere", ":6379", "host:", "ray://10.0.0.1:10001", "host:port")


def answering(answer):
    """Return the address of a server that sends an answer to its first client."""
    server = socket.create_server(("127.0.0.1", 0))

    def serve():
        connection, _ = server.accept()
        with connection, server:
            connection.recv(64)
            connection.sendall(answer)

    threading.Thread(target=serve, daemon=True).start()
    return f"127.0.0.1:{server.getsockname()[1]}"


def test_invalid_addresses_and_other_programs_are_refused_before_ray_is_started(monkeypatch):
    with socket.create_server(("127.0.0.1", 0)) as free:
        closed = f"127.0.0.1:{free.getsockname()[1]}"
    monkeypatch.setattr(module.sys, "executable", "false")  # Ray's program
    refusals = [
        *((address, ValueError, "cluster must be 'local', 'auto' or HOST:PORT") for address in NO_ADDRESSES),
        (closed, OSError, f"There is no cluster at {closed}: "),
        (answering(b"HTTP/1.1 400 Bad Request"), OSError, "the program that listens there is not Ray"),
        (answering(bytes((0, 0, 0, 4, 0, 0, 0, 0, 0))), OSError, "cannot be used: Ray ended without a message."),
    ]
    for address, error, message in refusals:
        with pytest.raises(error, match=re.escape(message)):
            module._address_of(address)


@pytest.mark.parametrize(
    ("text", "cluster", "otherwise", "reason"),
    [
        ("[x] W gcs_client.cc Unauthenticated: InvalidAuthToken\nConnectionError: no", "a:1", "", "it asks for a token"),
        ("Traceback:\n  File x\nConnectionError: Could not find any", "auto", "", "Ray is not running on this machine"),
        ("Traceback:\n  File x\nRuntimeError: Version mismatch\nmore", "a:1", "", "RuntimeError: Version mismatch"),
        ("", "a:1", "", "Ray ended without a message."),
        ("[x] W: waiting", "a:1", "it does not answer", "it does not answer"),
    ],
)
def test_the_reason_is_one_line(text, cluster, otherwise, reason):
    assert module._reason(text, cluster, otherwise).startswith(reason)


def test_a_node_that_would_compute_other_results_is_refused():
    (unit,) = drives("bearing", env="turtlebot_gym/TurtleBotNav-v0", episodes=2, seed=0)
    here = origin()
    assert module._same_origin(unit, here).facts
    for change, message in (
        ({"version": "9"}, "has turtlebot_gym .*, here it is 9: results could differ"),
        ({"libraries": {**here["libraries"], "numpy": "1.0"}}, "has numpy .*, here it is 1.0"),
        ({"libraries": {**here["libraries"], "other": "1.0"}}, "has no other, here it is 1.0"),
        ({"code": "0"}, "has turtlebot_gym with other code than here: results could differ."),
    ):
        with pytest.raises(OSError, match=message):
            module._same_origin(unit, here | change)
