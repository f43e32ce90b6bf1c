"""The notebooks: they run from top to bottom in a clean kernel, and what is stored is the output of such a run."""

import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

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


def code_cells(notebook):
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def texts(output):
    """Return the texts of an output."""
    shown = output.get("data", {})
    return [output.get("text", ""), *(text for kind, text in shown.items() if not kind.startswith("image/"))]


@needs_extras
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name.startswith("01") else pytest.mark.nightly) for name in NAMES]
)
def test_it_runs_from_top_to_bottom_in_a_clean_kernel(name, tmp_path, monkeypatch):
    monkeypatch.setenv("TURTLEBOT_GYM_QUICK", "1")
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path))  # no start-up files of the user
    monkeypatch.setenv("TMPDIR", str(tmp_path))  # where a notebook leaves what it trains
    # Without folders of kernels there is only the interpreter that runs the tests.
    kernel = AsyncKernelManager(kernel_spec_manager=KernelSpecManager(kernel_dirs=[]))
    client = NotebookClient(read(name), km=kernel, timeout=PATIENCE, resources={"metadata": {"path": str(FOLDER)}})
    client.execute(cleanup_kc=True)  # raises CellExecutionError where a cell fails


@pytest.mark.parametrize("name", NAMES)
def test_it_is_stored_as_it_ran(name):
    notebook = read(name)
    nbformat.validate(notebook)
    cells = code_cells(notebook)
    outputs = [output for cell in cells for output in cell.outputs]
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))
    assert any("image/png" in output.get("data", {}) for output in outputs)
    assert not [output for output in outputs if output.output_type == "error" or output.get("name") == "stderr"]


@pytest.mark.parametrize("name", NAMES)
def test_it_has_no_absolute_paths_and_no_dead_links(name):
    notebook = read(name)
    shown = [text for cell in code_cells(notebook) for output in cell.outputs for text in texts(output)]
    shown += [cell.source for cell in notebook.cells]
    assert not [text for text in shown if ABSOLUTE_PATH.search(text)]
    assert notebook.metadata.kernelspec.name == "python3"
    assert "widgets" not in notebook.metadata
    sources = [cell.source for cell in notebook.cells if cell.cell_type == "markdown"]
    assert not [link for source in sources for link in LINK.findall(source) if not (FOLDER / link).exists()]
    assert (FOLDER / name).stat().st_size < MAX_BYTES


def colab_cell(name):
    (cell,) = [cell for cell in code_cells(read(name)) if "colab" in cell.metadata.get("tags", ())]
    return cell.source


def test_the_cell_for_colab_is_the_first_and_the_same_in_all():
    extras = dict(re.findall(r"\[(\d\d_\w+\.ipynb)\].*\| (`agents`(?:, `ros`)?) \|", (FOLDER / "README.md").read_text()))
    cells = {name: colab_cell(name) for name in NAMES}
    assert all(code_cells(read(name))[0].source == cell for name, cell in cells.items())
    installed = {name: re.search(r"\[([a-z,]+)\]\"\]", cell)[1] for name, cell in cells.items()}
    assert installed == {name: text.replace("`", "").replace(" ", "") for name, text in extras.items()}
    assert len({cell.replace(installed[name], "") for name, cell in cells.items()}) == 1


@pytest.mark.parametrize("place", ["turtlebot_gym-0.0.0-py3-none-any.whl", "project/hatch_build.py"])
def test_it_installs_a_wheel_or_a_checkout_in_colab_only(place, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ran = []
    monkeypatch.setattr(subprocess, "run", lambda command, **_: ran.append(command))
    cell = compile(colab_cell("01_closed_loop.ipynb"), "cell", "exec")
    exec(cell, {})
    assert not ran
    monkeypatch.setitem(sys.modules, "google.colab", ModuleType("google.colab"))
    with pytest.raises(SystemExit, match=r"Upload turtlebot_gym-VERSION\.whl"):
        exec(cell, {})
    (tmp_path / place).parent.mkdir(exist_ok=True)
    (tmp_path / place).touch()
    exec(cell, {})
    wanted = tmp_path / place if place.endswith(".whl") else (tmp_path / place).parent
    assert ran == [[sys.executable, "-m", "pip", "install", "--quiet", f"{wanted}[agents]"]]
