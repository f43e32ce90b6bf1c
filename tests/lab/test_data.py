"""Recordings are fetched from their origin, and nothing else is kept."""

import functools
import hashlib
import http.server
import threading

import pytest

from turtlebot_gym_agents.commands.cli import main
from turtlebot_gym_lab.commands import data
from turtlebot_gym_lab.commands.data import RECORDINGS, Recording

CONTENT = b"t vx gyro\n" * 100


@pytest.fixture
def origin(tmp_path, monkeypatch):
    """The folder of a server on this machine, with a single recording."""
    folder = tmp_path / "origin"
    folder.mkdir()
    (folder / "drive.txt").write_bytes(CONTENT)

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_):
            """Say nothing."""

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=str(folder)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    url = f"http://127.0.0.1:{server.server_port}/drive.txt"
    recording = Recording(url, hashlib.sha256(CONTENT).hexdigest(), len(CONTENT), "MIT")
    monkeypatch.setattr(data, "RECORDINGS", {"set/drive.txt": recording})
    yield folder
    server.shutdown()
    server.server_close()


def fetched(tmp_path):
    return main(["data", "fetch", "--out", str(tmp_path / "data")])


def test_a_recording_is_fetched_once(origin, tmp_path, capsys):
    assert fetched(tmp_path) == 0
    assert (tmp_path / "data" / "set" / "drive.txt").read_bytes() == CONTENT
    (origin / "drive.txt").unlink()  # a second call asks for nothing
    assert fetched(tmp_path) == 0
    assert "yes" in capsys.readouterr().out


@pytest.mark.parametrize("content", [CONTENT + b"\n", CONTENT.replace(b"vx", b"vy"), b""])
def test_another_file_is_not_kept(origin, content, tmp_path, capsys):
    (origin / "drive.txt").write_bytes(content)
    assert fetched(tmp_path) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "another hash. Nothing was kept." in line
    assert not (tmp_path / "data" / "set").exists()


def test_an_existing_file_is_not_replaced(origin, tmp_path, capsys):
    mine = tmp_path / "data" / "set" / "drive.txt"
    mine.parent.mkdir(parents=True)
    mine.write_text("mine")
    assert fetched(tmp_path) == 2
    assert "exists and is not the recording" in capsys.readouterr().err
    assert mine.read_text() == "mine"


@pytest.mark.usefixtures("origin")
def test_without_a_network_one_line_says_so(tmp_path, capsys, monkeypatch):
    unreachable = data.RECORDINGS["set/drive.txt"]._replace(url="http://127.0.0.1:9/drive.txt")
    monkeypatch.setitem(data.RECORDINGS, "set/drive.txt", unreachable)
    assert fetched(tmp_path) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("turtlebot-gym: http://127.0.0.1:9/drive.txt cannot be reached: ")


def test_origins_are_fixed_commits_of_public_repositories():
    for name, recording in RECORDINGS.items():
        scheme, _, host, owner, repository, commit, *_ = recording.url.split("/")
        assert (scheme, host) == ("https:", "raw.githubusercontent.com")
        assert owner
        assert repository
        assert len(commit) == 40
        assert recording.url.endswith(f"/{name.rpartition('/')[2]}")
        assert len(recording.sha256) == 64
