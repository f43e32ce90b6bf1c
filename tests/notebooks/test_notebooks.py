"""The notebooks: they run in a folder of their own, and are stored as they ran. `make notebooks` stores their outputs anew."""

import os
import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

nbformat = pytest.importorskip("nbformat", reason="needs the extra [dev]")

FOLDER = Path(__file__).parents[2] / "notebooks"
NAMES = sorted(path.name for path in FOLDER.glob("*.ipynb"))
MAX_BYTES = 600_000
ABSOLUTE_PATH = re.compile(rf"(?<![\w.])/(?:home|mnt|opt|root|tmp|Users|usr|var)/|{re.escape(str(FOLDER.parent))}")
LINK = re.compile(r"\]\(([^):#]+)\)")

needs_extras = pytest.mark.skipif(
    not all(map(find_spec, ("nbclient", "stable_baselines3", "rosidl_generator_py"))), reason="needs the extras [dev] and [ros]"
)


@needs_extras
@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_it_runs_from_top_to_bottom(name, tmp_path):
    shutil.copy(FOLDER / name, tmp_path)
    places = {"IPYTHONDIR": tmp_path / "ipython", "TMPDIR": tmp_path}  # no start-up files of the user
    command = [sys.executable, FOLDER / "execute.py", name]
    subprocess.run(command, cwd=tmp_path, env={**os.environ, **places}, check=True, timeout=600)


@pytest.mark.parametrize("name", NAMES)
def test_it_is_stored_as_it_ran(name):
    notebook = nbformat.read(FOLDER / name, as_version=4)
    nbformat.validate(notebook)
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    outputs = [output for cell in cells for output in cell.outputs]
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))
    assert any("image/png" in output.get("data", {}) for output in outputs)
    assert not [output for output in outputs if output.output_type == "error" or output.get("name") == "stderr"]
    sources = [cell.source for cell in notebook.cells if cell.cell_type == "markdown"]
    assert not [link for source in sources for link in LINK.findall(source) if not (FOLDER / link).exists()]
    assert not ABSOLUTE_PATH.search(str(notebook.cells))
    assert (FOLDER / name).stat().st_size < MAX_BYTES
