"""No rule, default or number of a preset has changed that was not meant to; `declared` writes them down."""

import json
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="needs the extra [ros]")

import declared

STORED = json.loads((Path(__file__).parent / "declared.json").read_text())
NOW = declared.snapshot()


@pytest.mark.parametrize(("kind", "name"), [(kind, name) for kind, named in STORED.items() for name in named])
def test_what_is_declared_is_what_was_stored(kind, name):
    assert NOW[kind].get(name) == STORED[kind][name]


@pytest.mark.parametrize("kind", STORED)
def test_all_that_is_declared_was_stored(kind):
    """A further preset changes none of those that there are."""
    new = NOW[kind].keys() - STORED[kind].keys()
    assert not new or kind in declared.PRESETS, new
