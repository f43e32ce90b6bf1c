"""Check whether a cluster can do the work, in a separate process that is abandoned if nothing answers in time."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from turtlebot_gym_agents.cluster import probe as script
from turtlebot_gym_agents.cluster.origin import difference, origin

PATIENCE = 10.0
"""Time for a cluster to answer, s."""
_GREETING = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + bytes((0, 0, 0, 4, 0, 0, 0, 0, 0))
"""First bytes of HTTP/2, and so of gRPC, which Ray uses."""
_SETTINGS = 4


def access() -> dict[str, str]:
    """Return the variables with which Ray sends its token to a cluster, if there is a token and they are not set otherwise."""
    token = (
        any(name in os.environ for name in ("RAY_AUTH_TOKEN", "RAY_AUTH_TOKEN_PATH"))
        or (Path.home() / ".ray" / "auth_token").is_file()
    )
    return {"RAY_AUTH_MODE": "token"} if token else {}


def probe(cluster: str) -> tuple[str, list[dict[str, Any]]]:
    """Return the address and the nodes of a cluster that can do the work.

    Args:
        cluster: "auto", or its address.

    Raises:
        ValueError: If ``cluster`` is not an address.
        OSError: If nothing answers there, or a node would compute other results than this one.
    """
    begun = time.monotonic()
    if cluster != "auto":
        _require_ray(cluster)
    seconds = PATIENCE - (time.monotonic() - begun)
    command = [sys.executable, str(script.__file__), cluster, str(seconds - 2.0)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    pipes: dict[str, Any] = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    out = ""
    with subprocess.Popen(command, **pipes, text=True, env=environment) as process:
        try:
            out, err = process.communicate(timeout=seconds)
        except subprocess.TimeoutExpired:
            process.kill()
            _, err = process.communicate()
            if "AuthToken" not in err:
                raise OSError(f"The cluster {cluster!r} does not answer within {PATIENCE:g} s.") from None
        finally:
            process.kill()
    if process.returncode != 0:
        raise OSError(f"The cluster {cluster!r} cannot be used: {_reason(err, cluster)}")
    told = json.loads(out.strip().splitlines()[-1])
    if not told["nodes"]:
        raise OSError(f"The cluster {cluster!r} has no node with a core.")
    for node in told["nodes"]:
        _require_same(node["host"], node["origin"])
    return told["address"], told["nodes"]


def _require_ray(address: str) -> None:
    """Raise ValueError or OSError unless Ray answers at an address."""
    host, colon, port = address.rpartition(":")
    if not (colon and host and port.isdigit()) or "/" in host:
        raise ValueError(f"cluster must be 'local', 'auto' or HOST:PORT, as `ray start --head` prints it, got {address!r}.")
    try:
        with socket.create_connection((host, int(port)), timeout=4.0) as connection:
            if os.environ.get("RAY_USE_TLS", "0") in ("0", ""):
                connection.sendall(_GREETING)
                answer = connection.recv(9)
                if len(answer) < 4 or answer[3] != _SETTINGS:
                    raise OSError("the program that listens there is not Ray")
    except TimeoutError:
        raise OSError(f"There is no cluster at {address}: nothing answers.") from None
    except (OSError, OverflowError) as error:
        raise OSError(f"There is no cluster at {address}: {error}.") from error


def _require_same(host: str, there: dict[str, Any] | None) -> None:
    """Raise OSError unless a node would compute the same results as this one."""
    if there is None:
        raise OSError(f"The node {host} of the cluster does not answer.")
    if "missing" in there:
        raise OSError(
            f"The node {host} of the cluster lacks the module {there['missing']}: install turtlebot-gym[cluster] in the "
            "environment in which `ray start` runs there."
        )
    if other := difference(origin(), there):
        raise OSError(f"The node {host} of the cluster has {other}: results could differ.")


def _reason(text: str, cluster: str) -> str:
    """Return Ray's error as one line."""
    if "AuthToken" in text or "AuthenticationError" in text:
        return "it asks for a token: set RAY_AUTH_MODE=token and RAY_AUTH_TOKEN as where `ray start` ran."
    if cluster == "auto" and "ConnectionError" in text:
        return "Ray is not running on this machine; `ray start` makes it part of a cluster, and 'local' needs none."
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith((" ", "\t", "["))]
    return ([line for line in lines if "Error: " in line] or lines or ["Ray ended without a message."])[-1]
