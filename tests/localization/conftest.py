"""Shared by the tests of the localizer."""

import pytest
from localization_rooms import hall, make_room, scan_of


@pytest.fixture(scope="session")
def in_hall():
    """Return the hall, a pose in it, and its scan."""
    room, pose = make_room(hall()), (1.7, 2.1, 0.4)
    return room, pose, scan_of(room, pose)
