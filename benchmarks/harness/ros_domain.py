"""ROS domains that no other process on this machine uses."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager

DOMAINS = range(120, 180)
"""Domains of benchmarks, above those of users and of the tests."""
PORT = 27000
"""Port by which a domain is claimed, less its number, as in the tests."""


@contextmanager
def claimed_domain() -> Iterator[int]:
    """Claim a domain.

    Raises:
        RuntimeError: If all are claimed.
    """
    for domain in DOMAINS:
        with socket.socket() as claim:
            try:
                claim.bind(("127.0.0.1", PORT + domain))
            except OSError:
                continue
            yield domain
            return
    raise RuntimeError(f"All ROS domains from {DOMAINS.start} to {DOMAINS.stop - 1} are claimed on this machine.")
