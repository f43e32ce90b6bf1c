"""Where the results of `make test-clients` are written."""

from pathlib import Path


def pytest_addoption(parser):
    """Add the option that the target gives."""
    parser.addoption("--clients-json", type=Path, default=None, help="write the results of the clients here")
