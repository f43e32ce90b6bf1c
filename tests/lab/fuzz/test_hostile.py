"""No recording makes its reader take more than 10 s or 1 GB: it is read, or refused with one line."""

import pytest

for needed in ("stable_baselines3", "onnx", "onnxruntime", "rosbags", "PIL", "lz4"):
    pytest.importorskip(needed, reason="needs the extras [agents] and [ros]")

from bounds import require_bounded, require_many_bounded
from hostile_recordings import KINDS

pytestmark = pytest.mark.touched("lab", "tests/lab")

NAMED = (
    "bag_with_a_map_of_many_cells",
    "npz_of_zeros",
    "table_of_many_columns",
    "mcap_chunk_of_zeros",
    "recording_that_is_no_file",
    "part_of_a_bag_that_is_no_file",
)
"""Kinds of which one file each is tried in every run."""


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", NAMED)
def test_a_hostile_file_is_read_or_refused_within_bounds(name, tmp_path):
    require_bounded(KINDS, name, 0, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_many_hostile_files_are_read_or_refused_within_bounds(name, tmp_path):
    require_many_bounded(KINDS, name, tmp_path)
