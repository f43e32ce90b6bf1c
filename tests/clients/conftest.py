"""Results file of the tests marked ``slow``."""

from pathlib import Path


def pytest_addoption(parser):
    """Add the option that the make target passes."""
    parser.addoption("--clients-json", type=Path, default=None, help="write the results of the clients here")
