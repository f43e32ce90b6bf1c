"""The notebooks: they run in an empty folder, and are stored as they ran. `make notebooks` stores their outputs anew."""

import re
from importlib.util import find_spec
from pathlib import Path

import pytest

pytest.importorskip("nbclient", reason="needs the extra [dev]")

import nbformat
from jupyter_client import AsyncKernelManager
from jupyter_client.kernelspec import KernelSpecManager
from nbclient import NotebookClient

FOLDER = Path(__file__).parents[2] / "notebooks"
NAMES = sorted(path.name for path in FOLDER.glob("*.ipynb"))
PATIENCE = 300
"""Longest wait for a cell, s: far above what it takes."""
MAX_BYTES = 600_000
ABSOLUTE_PATH = re.compile(rf"(?<![\w.])/(?:home|mnt|opt|root|tmp|Users|usr|var)/|{re.escape(str(FOLDER.parent))}")
LINK = re.compile(r"\]\(([^):#]+)\)")

needs_extras = pytest.mark.skipif(
    not all(map(find_spec, ("stable_baselines3", "rosidl_generator_py"))), reason="needs the extras [agents] and [ros]"
)


def read(name):
    return nbformat.read(FOLDER / name, as_version=4)


def executed(name, folder, monkeypatch):
    """Return a notebook after it ran from top to bottom in a clean kernel and an empty folder."""
    monkeypatch.setenv("IPYTHONDIR", str(folder / "ipython"))  # no start-up files of the user
    monkeypatch.setenv("TMPDIR", str(folder))  # where a notebook leaves what it trains
    (folder / "empty").mkdir()
    # Without folders of kernels there is only the interpreter that runs the tests.
    kernel = AsyncKernelManager(kernel_spec_manager=KernelSpecManager(kernel_dirs=[]))
    notebook, resources = read(name), {"metadata": {"path": str(folder / "empty")}}
    client = NotebookClient(notebook, km=kernel, timeout=PATIENCE, resources=resources, coalesce_streams=True)
    return client.execute(cleanup_kc=True)  # raises CellExecutionError where a cell fails


@needs_extras
@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_it_runs_from_top_to_bottom(name, tmp_path, monkeypatch):
    monkeypatch.setenv("TURTLEBOT_GYM_QUICK", "1")
    executed(name, tmp_path, monkeypatch)


@pytest.mark.parametrize("name", NAMES)
def test_it_is_stored_as_it_ran(name):
    notebook = read(name)
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
