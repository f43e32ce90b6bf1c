"""The notebooks: they run in an empty folder, and each number that is stored is that of the present code.

``pytest tests/notebooks`` is the check; `make test-all` has it. `make notebooks` stores the outputs anew.
"""

import os
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
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:,\d{3})*(?:\.\d+)?(?:e[-+]?\d+)?")
TOLERANCES = {"": (1e-3, 1e-6), "live": (0.1, 0.1), "trained": (0.25, 0.5)}
"""Relative and absolute difference of a number, beside a unit of its last digit, by the tag of its cell: "live" runs in real
time, and what is "trained" differs between processors."""
DATA = Path(os.environ.get("TURTLEBOT_GYM_DATA", FOLDER.parents[1] / "shared" / "data"))
"""Recorded drives of the notebook on your robot."""


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
    as_text = "text/plain" in shown  # HTML says the same, and holds pictures
    kinds = [kind for kind in shown if not kind.startswith("image/") and not (as_text and kind == "text/html")]
    return [output.get("text", ""), *(shown[kind] for kind in kinds)]


def printed(cell):
    """Return the text that a cell prints and shows."""
    return "".join(text for output in cell.outputs if "image/png" not in output.get("data", {}) for text in texts(output))


def stale(stored, present, tags=()):
    """Return the lines of a cell's text that are not those of the present code."""
    relative, absolute = next((TOLERANCES[tag] for tag in tags if tag in TOLERANCES), TOLERANCES[""])

    def same(old, new):
        digits = len(old.partition(".")[2].partition("e")[0])
        unit = 1.01 * 10.0**-digits if "e" not in old else 0.0
        a, b = (float(text.replace(",", "")) for text in (old, new))
        return abs(a - b) <= max(relative * abs(a), absolute, unit)

    def words(line):
        return NUMBER.sub("#", line).split()

    before, after = stored.splitlines(), present.splitlines()
    if len(before) != len(after):
        return [f"{len(before)} lines are stored, {len(after)} printed: {present}"]
    return [
        f"{old} -> {new}"
        for old, new in zip(before, after, strict=True)
        if words(old) != words(new) or not all(map(same, NUMBER.findall(old), NUMBER.findall(new)))
    ]


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


@pytest.mark.nightly
@needs_extras
def test_the_first_runs_in_its_short_form(tmp_path, monkeypatch):
    monkeypatch.setenv("TURTLEBOT_GYM_QUICK", "1")
    executed("01_closed_loop.ipynb", tmp_path, monkeypatch)


@needs_extras
@pytest.mark.nightly
@pytest.mark.parametrize("name", NAMES)
def test_its_outputs_are_those_of_the_present_code(name, tmp_path, monkeypatch):
    if name.startswith("05") and not (DATA / "wifibot1.txt").exists():
        pytest.skip(f"needs the recorded drives in {DATA}")
    monkeypatch.delenv("TURTLEBOT_GYM_QUICK", raising=False)
    monkeypatch.setenv("TURTLEBOT_GYM_DATA", str(DATA))
    cells = zip(code_cells(read(name)), code_cells(executed(name, tmp_path, monkeypatch)), strict=True)
    found = [line for old, new in cells for line in stale(printed(old), printed(new), old.metadata.get("tags", ()))]
    assert not found, "\n".join(["run make notebooks; what is stored -> what is printed:", *found])


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
