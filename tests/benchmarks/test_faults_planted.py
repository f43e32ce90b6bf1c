"""The defects that are planted for the injected faults: each can be planted, each kind has one, a missed one is reported."""

import pytest

pytest.importorskip("rclpy", reason="needs the extra [ros]")

import faults_planted
from faults_kinds import FAULTS
from faults_planted import ROOT, Config, defects, find, without_defect

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
@pytest.mark.parametrize(("test", "found"), [("assert x == 1", True), ("assert x", False), ("1 / 0 ; broken(", False)])
def test_a_test_finds_a_defect_if_it_fails_and_not_if_it_passes_or_cannot_run(monkeypatch, tmp_path, test, found):
    (tmp_path / "part").mkdir()
    (tmp_path / "part" / "module.py").write_text("x = 1\n")
    (tmp_path / "part" / "test_module.py").write_text(f"from module import x\n\n\ndef test_it():\n    {test}\n")
    monkeypatch.setattr(faults_planted, "ROOT", tmp_path)
    monkeypatch.setattr(faults_planted, "PARTS", ["part"])
    edit = {"file": "part/module.py", "old": "x = 1", "new": "x = 2"}
    row = find({"name": "doubled", "edit": [edit], "tests": ["part/test_module.py"]}, Config())
    assert row["found"] is found
