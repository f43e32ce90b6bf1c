"""The defects that are planted for the injected faults: each can be planted, each kind has one, a missed one is reported."""

import subprocess
import sys

import pytest

pytest.importorskip("rclpy", reason="needs the extra [ros]")

import faults_planted
from faults_kinds import FAULTS
from faults_planted import ROOT, Config, defects, environment_of, files_of, find, not_in_force, plant, without_defect

DEFECTS = defects(Config())


@pytest.mark.parametrize("defect", DEFECTS, ids=[defect["name"] for defect in DEFECTS])
def test_each_text_occurs_exactly_once_and_is_changed(defect):
    for edit in defect["edit"]:
        assert (ROOT / edit["file"]).read_text(encoding="utf-8").count(edit["old"]) == 1, edit
        assert edit["old"] != edit["new"]
    assert set(defect.get("kinds", [])) <= set(FAULTS)
    assert defect.get("kinds") or defect.get("tests")


def test_each_kind_has_a_defect_that_makes_it_unsafe_and_twenty_are_named():
    assert without_defect() == []
    assert len(defects(Config(named=True))) >= 20


def module_of(path):
    """Return the name by which a file is imported."""
    parts = [path.stem]
    while (path := path.parent).joinpath("__init__.py").is_file():
        parts.insert(0, path.name)
    return ".".join(parts)


def test_a_copy_imports_each_changed_module_from_itself_wherever_the_project_is_installed(tmp_path):
    plant({"edit": []}, tmp_path)
    files = sorted({name for defect in DEFECTS for name in files_of(defect)})
    modules = [module_of(ROOT / file) for file in files]
    script = "import importlib.util, sys\nfor name in sys.argv[1:]: print(importlib.util.find_spec(name).origin)"
    command = [sys.executable, "-c", script, *modules]
    done = subprocess.run(command, cwd=tmp_path, env=environment_of(tmp_path), capture_output=True, text=True)
    assert done.stdout.splitlines() == [str(tmp_path / file) for file in files]


@pytest.mark.parametrize(
    ("looks", "imported", "force"),
    [("kinds", True, True), ("kinds", False, False), ("kinds", None, False), ("tests", False, True), ("tests", None, False)],
)
def test_a_defect_is_in_force_where_a_node_of_the_copy_or_a_test_has_imported_it(tmp_path, looks, imported, force):
    defect = {looks: ["any"], "edit": [{"file": "module.py"}, {"file": "module.py"}]}
    (tmp_path / "imported").write_text(f"{ROOT / 'module.py'}\tTrue\n")  # where the project is installed
    if imported is not None:
        (tmp_path / "imported").write_text(f"{tmp_path / 'module.py'}\t{imported}\n")
    assert not_in_force(defect, tmp_path) == ([] if force else ["module.py"])


@pytest.mark.parametrize("times", [0, 2])
def test_a_defect_whose_text_is_not_there_once_counts_as_not_found(monkeypatch, tmp_path, times):
    (tmp_path / "part").mkdir()
    (tmp_path / "part" / "module.py").write_text("x = 1\n" * times)
    monkeypatch.setattr(faults_planted, "ROOT", tmp_path)
    monkeypatch.setattr(faults_planted, "PARTS", ["part"])
    edit = {"file": "part/module.py", "old": "x = 1", "new": "x = 2"}
    row = find({"name": "lost", "edit": [edit], "kinds": ["odometry dead"]}, Config())
    assert not row["found"]
    assert row["why"] == f"not planted: 'x = 1' occurs {times} times in part/module.py"


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("imports", "test", "found"),
    [
        ("from module import x", "assert x == 1", True),
        ("from module import x", "assert x", False),
        ("from module import x", "1 / 0 ; broken(", False),
        ("", "assert False", False),  # whatever fails without the defect has not noticed it
    ],
)
def test_a_test_finds_a_defect_if_it_fails_by_it_and_not_if_it_passes_or_cannot_run(
    monkeypatch, tmp_path, imports, test, found
):
    (tmp_path / "part").mkdir()
    (tmp_path / "part" / "module.py").write_text("x = 1\n")
    (tmp_path / "part" / "test_module.py").write_text(f"{imports}\n\n\ndef test_it():\n    {test}\n")
    monkeypatch.setattr(faults_planted, "ROOT", tmp_path)
    monkeypatch.setattr(faults_planted, "PARTS", ["part"])
    edit = {"file": "part/module.py", "old": "x = 1", "new": "x = 2"}
    row = find({"name": "doubled", "edit": [edit], "tests": ["part/test_module.py"]}, Config())
    assert row["found"] is found
