"""The law of files: product and satellites read and write them by `turtlebot_gym.files`, with a few named exceptions."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PRODUCT = ("turtlebot_gym", "agents/turtlebot_gym_agents", "bridges/turtlebot_gym_ros/turtlebot_gym_ros")
SATELLITES = ("lab/turtlebot_gym_lab", "lab/turtlebot_gym_view")
PACKAGES = [top for top in (*PRODUCT, *SATELLITES) if (ROOT / top).is_dir()]
OPENING = {
    "open",
    "read_text",
    "read_bytes",
    "write_text",
    "write_bytes",
    "savefig",
    "loadtxt",
    "genfromtxt",
    "savez",
    "savetxt",
    "savez_compressed",
    "ZipFile",
    "unpack_archive",
    "safe_load",
    "full_load",
    "load_all",
    "fromfile",
    "memmap",
    "imread",
    "imsave",
    "write_frames",
    "NamedTemporaryFile",
    "mkstemp",
    "rename",
    "copyfile",
}
"""Methods and functions that open a file, whatever has them."""
OF_LIBRARIES = {
    "np.load",
    "np.save",
    "yaml.load",
    "yaml.dump",
    "pickle.load",
    "pickle.dump",
    "json.load",
    "json.dump",
    "torch.load",
    "torch.save",
    "onnx.load",
    "onnx.save",
    "Image.open",
    "ElementTree.parse",
    "ET.parse",
    "tomllib.load",
    "sqlite3.connect",
    "csv.reader",
}
"""Functions of libraries that open a file, or parse one that is open."""
OURS = {"read_text", "read_bytes", "write_text"}
"""Functions of `files`, called by their bare names or as ``files.NAME``."""
ALLOWED = {
    "turtlebot_gym/files.py": "here",
    "turtlebot_gym/bounded.py": "the pipe from the copy of the process",
    "turtlebot_gym/compiled/cache.py": "source code of the package",
    "turtlebot_gym/compiled/store.py": "machine code that the package has stored, in a format of its own",
    "turtlebot_gym/extras.py": "metadata of the installed package",
    "turtlebot_gym_ros/tools/messages.py": "a text for the terminal",
    "turtlebot_gym_lab/drives/laser.py": "within the bounds of `drives.read`",
    "turtlebot_gym_lab/drives/tables.py": "within the bounds of `drives.read`",
    "turtlebot_gym/rooms/maps.py": "within bounds",
    "turtlebot_gym_agents/cluster/ledger.py": "a record that grows, which must survive as far as it came",
    "turtlebot_gym_agents/cluster/study.py": "what a training has just written; replaced as a whole",
    "turtlebot_gym_agents/commands/console.py": "replaced as a whole",
    "turtlebot_gym_lab/scans/map_files.py": "replaced as a whole",
    "turtlebot_gym_agents/front/driving.py": "replaced as a whole",
    "turtlebot_gym_agents/front/film.py": "replaced as a whole",
    "turtlebot_gym_agents/front/results.py": "into memory",
    "turtlebot_gym_agents/outputs.py": "whether an output can be written",
    "turtlebot_gym_agents/policies/bundle.py": "replaced as a whole",
    "turtlebot_gym_agents/process.py": "/dev/null",
    "turtlebot_gym_agents/training/files.py": "models of other libraries, which these libraries read",
    "turtlebot_gym_agents/training/model.py": "within bounds; replaced as a whole",
    "turtlebot_gym_view/view.py": "a file of the package",
    "turtlebot_gym_ros/blocks/waypoints.py": "cells in lines that `files` has read",
    "turtlebot_gym_ros/graph/bringup.py": "replaced as a whole",
    "turtlebot_gym_ros/recording/bag.py": "a recording that grows, which must survive as far as it came",
    "turtlebot_gym_ros/recording/logger.py": "a recording that grows, which must survive as far as it came",
}
"""Modules that open files by themselves, each with the reason."""
SCREENS = {"webbrowser.open", "self.open", "feed.open", "reader.open", "self._writer.open"}
"""What is opened and is no file."""


def modules():
    for top in PACKAGES:
        for path in sorted((ROOT / top).rglob("*.py")):
            yield str(path.relative_to((ROOT / top).parent)), path


def openings(text):
    """Yield each call in a module that opens a file without `files`."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Call):
            name = ast.unparse(node.func)
            last = name.rpartition(".")[2]
            of_files = name in OURS or (name.startswith("files.") and last in OURS)
            if (last in OPENING or name in OF_LIBRARIES) and not of_files and name not in SCREENS:
                yield ast.unparse(node)


def test_files_are_opened_where_it_is_said_why():
    found = {name: list(openings(path.read_text())) for name, path in modules()}
    opening = {name: calls for name, calls in found.items() if calls}
    assert {name: calls for name, calls in opening.items() if name not in ALLOWED} == {}
    names = {Path(top).name for top in PACKAGES}
    assert sorted({name for name in ALLOWED if name.partition("/")[0] in names} - set(opening)) == []


@pytest.mark.parametrize(
    "planted",
    [
        "open(path)",
        "Path(path).read_text()",
        "np.load(path)",
        "yaml.safe_load(text)",
        "ElementTree.parse(path)",
        "Image.open(path)",
        "path.write_text(text)",
        "figure.savefig(path)",
        "path.open('w')",
        "zipfile.ZipFile(path)",
    ],
)
def test_the_law_notices_what_is_planted(planted):
    assert list(openings(f"def read(path):\n    return {planted}\n"))


def test_the_law_lets_the_module_be_used():
    assert not list(
        openings("def read(path):\n    return read_text(path), files.read_bytes(path), files.write_text(path, '')\n")
    )
