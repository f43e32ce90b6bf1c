"""Peers are measured in turns with this package, and one that cannot be had is named with the cause."""

import io
import json
import os
import subprocess
import sys

import pytest

import peers
from harness import peer
from harness.turns import Turn
from peers import Config, Peer


class StandIn:
    """A process whose calls take a given time; one that is told to fails."""

    def __init__(self, command, log, **options):
        self.name, size = command[-2:]
        assert options["env"]["TURTLEBOT_GYM_THREADS"] == "1"
        if self.name == "JaxNav":
            raise ChildProcessError("The process has ended with status 1: no such module")
        self.ready = {"steps": 2 * int(size), "start": 3.0}

    def turn(self, calls):
        seconds = {"TurtleBotRooms": 1e-6, "IR-SIM": 5e-6}[self.name] * calls * self.ready["steps"]
        return Turn(2.0 * seconds, seconds)

    def stop(self):
        pass


@pytest.fixture
def stand_in(monkeypatch):
    monkeypatch.setattr(peers, "Process", StandIn)
    monkeypatch.setattr(peers, "calls_for", lambda turn, seconds: 4)


def test_a_peer_is_compared_by_cpu_time_and_one_that_fails_is_named(stand_in):
    failed = {"envpool": "ERROR: no wheel"}
    asked = Peer("IR-SIM", "ir-sim"), Peer("JaxNav", "jaxmarl"), Peer("EnvPool's Pendulum", "envpool")
    rows, _ = peers.compared(("TurtleBotRooms", 8), asked, Config(rounds=3), failed)
    (row,) = rows
    assert (row["peer"], row["ours"], row["size"]) == ("IR-SIM", "TurtleBotRooms", 8)
    assert row["ratio"] == pytest.approx({"value": 5.0, "low": 5.0, "high": 5.0})
    assert row["peer_ns"]["cpu"]["value"] == pytest.approx(5000.0)
    assert row["peer_ns"]["wall"] == pytest.approx(10_000.0)
    assert row["ours_ns"]["first_use_s"] == 3.0
    assert failed == {"envpool": "ERROR: no wheel", "JaxNav": "The process has ended with status 1: no such module"}


def test_this_package_must_run(stand_in):
    with pytest.raises(ChildProcessError, match="no such module"):
        peers.compared(("JaxNav", 1), (), Config(), {})


def test_a_project_that_pip_cannot_install_is_named_with_the_cause(monkeypatch, tmp_path):
    def run(command, **options):
        lost = "envpool" in command
        return subprocess.CompletedProcess(
            command, int(lost), "", "WARNING: slow\nERROR: no version of envpool\n" if lost else ""
        )

    monkeypatch.setattr(peers.subprocess, "run", run)
    assert peers.install(tmp_path) == {"envpool": "ERROR: no version of envpool"}


def test_each_peer_has_a_program_and_each_project_a_version():
    named = {entry.name for entries in peers.PEERS.values() for entry in entries} | {ours for ours, _ in peers.PEERS}
    assert named == peer.PROGRAMS.keys()
    pinned = {line.partition("==")[0] for line in peers.PINNED.read_text(encoding="utf-8").splitlines()}
    assert {entry.project for entries in peers.PEERS.values() for entry in entries} == peers.PROJECTS.keys() <= pinned


def test_the_program_answers_with_the_steps_of_a_call(monkeypatch, capsys):
    monkeypatch.setattr(sys, "stdin", io.StringIO("2\n"))
    monkeypatch.delattr(os, "sched_setaffinity")  # this process keeps its cores
    peer.main("CartPole", "3")
    ready, turn = capsys.readouterr().out.splitlines()
    assert json.loads(ready.removeprefix("ready"))["steps"] == 3
    assert min(json.loads(turn.removeprefix("turn"))) > 0.0
