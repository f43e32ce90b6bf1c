"""A ROS domain for each test process, so that its kernels and nodes receive no messages from others; hypothesis' profile."""

import os
import socket

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


def pytest_unconfigure():
    """Release the domain."""
    _CLAIM.close()
