"""A ROS domain for each test process: what it starts, kernels and nodes, hears nobody else."""

import os
import socket


def claim_domain():
    """Return a ROS domain that no other test process on this machine has, and a port that holds the claim while it is open."""
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


def pytest_unconfigure():
    """Let go of the domain."""
    _CLAIM.close()
