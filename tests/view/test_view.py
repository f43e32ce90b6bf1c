"""The view without a browser: a file holds all that it needs, and names are text; what `watch` refuses."""

import re
import sys
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

pytest.importorskip("bokeh", reason="needs the extra [agents]")

from bokeh.document import Document
from bokeh.models.glyphs import Image as ImageGlyph

from turtlebot_gym.drive import Drive, RoomData, Seen
from turtlebot_gym.rooms.grid import GridMap
from turtlebot_gym.rooms.scan import Obstacles, Scan
from turtlebot_gym.values import Pose
from turtlebot_gym_agents.commands.cli import main
from turtlebot_gym_view.maps import _extent, _picture
from turtlebot_gym_view.page import Page
from turtlebot_gym_view.view import fill

LIMIT = 3_000_000
"""Largest file of a drive of 60 s, bytes."""


def make_drive(rows=601, *, label="noise", scans=300, room=None):
    """Return a drive of random numbers, which nothing can compress: of 60 s with a scan of 360 beams in every second step."""
    rng = np.random.default_rng(0)
    ranges = rng.uniform(0.1, 3.5, (scans, 360)).astype(np.float32)
    seen = [Seen(min(2 * k, rows - 1), Pose(0.0, 0.0, 0.0), Scan(row, 0.0, 0.0175, 0.1, 3.5)) for k, row in enumerate(ranges)]
    return Drive(
        time=0.1 * np.arange(rows),
        true_state=rng.normal(size=(rows, 5)),
        odometry=rng.normal(size=(rows, 3)),
        estimate=rng.normal(size=(rows, 5)),
        covariance=np.tile(0.01 * np.eye(3), (rows, 1, 1)),
        reference=np.ones((rows, 3)),
        command=rng.normal(size=(rows, 2)),
        nis=rng.chisquare(3, rows),
        clearance=rng.uniform(size=rows),
        scans=tuple(seen),
        around=RoomData(label, room=room),
    )


class Loads(HTMLParser):
    """What a page loads by itself, and the styles in it."""

    def __init__(self, page):
        super().__init__()
        self.loads, self.frames, self.styles, self._in_style = [], [], "", False
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        self._in_style = tag == "style"
        self.frames += [attributes["srcdoc"]] if "srcdoc" in attributes else []
        self.loads += [value for name in ("src", "href", "srcset", "data") if tag != "a" and (value := attributes.get(name))]

    def handle_data(self, data):
        self.styles += data if self._in_style else ""


def test_a_file_of_60_s_is_small_and_loads_nothing(tmp_path):
    size = Page(drives=[make_drive()], title="60 s").save(tmp_path / "drive.html")
    assert size == (tmp_path / "drive.html").stat().st_size < LIMIT
    page = Loads((tmp_path / "drive.html").read_text(encoding="utf-8"))
    assert all(url.startswith("data:") for url in page.loads)
    assert not re.search(r"@import|url\(", page.styles)


def test_names_are_text():
    page = Page(drives=[make_drive(5, label="<script>alert(1)</script>", scans=1)], title="</title><b>").html()
    assert "<script>alert(1)" not in page
    assert "</title><b>" not in page


def test_a_notebook_shows_the_page_in_a_frame_that_loads_nothing():
    page = Page(drives=[make_drive(3, scans=1)], title='"A" & B')
    shown = Loads(page._repr_html_())
    assert shown.loads == []
    assert shown.frames == [page.html()] or len(shown.frames[0]) == len(page.html())  # but for the numbers of models
    assert "A&quot; &amp; B" in page._repr_html_()


def test_drives_in_one_room_share_a_map_and_others_do_not():
    def maps(drives):
        document = Document()
        fill(document, drives, title="")
        return sum(str(root.name).startswith("map") for root in document.roots)

    here, there = (Obstacles((at, 0.0, 5.0, 3.0), (), ()) for at in (0.0, 9.0))
    drives = [make_drive(3, room=room, scans=1) for room in (here, here, there)]
    assert maps(drives[:2]) == 1
    assert maps(drives) == 2
    assert maps([drives[0], make_drive(3, scans=1)]) == 2


@pytest.mark.parametrize("number", [0, 7])
def test_a_wrong_number_of_drives_is_refused(number):
    with pytest.raises(ValueError, match="1 to 6 drives"):
        Page(drives=[make_drive(3, scans=1)] * number).html()


def test_the_view_holds_the_room_and_the_paths():
    room = Obstacles((1.0, 0.0, 5.0, 3.0), (), ())
    low, high = _extent([make_drive(3, room=room, scans=1)])
    assert np.all(low <= (-4.0, -3.0))
    assert np.all(high >= (6.0, 3.0))
    still = make_drive(1, scans=1)
    standing = replace(still, true_state=np.zeros((1, 5)), estimate=np.zeros((1, 5)), reference=np.full((1, 3), np.nan))
    low, high = _extent([standing])
    np.testing.assert_allclose(high - low, 2.0)  # never nothing


def test_a_map_becomes_a_picture_with_all_of_its_walls():
    cells = np.zeros((2, 3), np.int8)
    cells[0, 2], cells[1, 0] = 100, -1
    shown, place = _picture(GridMap(cells=cells, resolution=0.5, origin=Pose(1.0, 2.0, 0.0)))
    np.testing.assert_array_equal(shown, [[0, 0, 2], [1, 0, 0]])
    assert place == pytest.approx((1.0, 2.0, 1.5, 1.0))
    turned, place = _picture(GridMap(cells=cells, resolution=0.5, origin=Pose(1.0, 2.0, np.pi / 2.0)))
    np.testing.assert_array_equal(turned, [[1, 0], [0, 0], [0, 2]])  # rows go up, and columns to the left
    assert place == pytest.approx((0.0, 2.0, 1.0, 1.5))
    large = np.zeros((10, 4000), np.int8)
    large[:, 1001] = 100  # a thin wall
    shown, _ = _picture(GridMap(cells=large, resolution=0.05))
    assert shown.shape[1] <= 800
    assert (shown == 2).any(axis=1).all()


def test_a_map_is_drawn_with_a_form_for_dark_pages():
    cells = np.zeros((20, 30), np.int8)
    cells[5, 3:20], cells[:4, :] = 100, -1
    drive = make_drive(3, scans=1)
    grid = GridMap(cells=cells, resolution=0.2, origin=Pose(-3.0, -2.0, 0.3))
    document = Document()
    fill(document, [replace(drive, around=drive.around._replace(grid=grid))], title="")
    mappers = {image.color_mapper for image in document.select({"type": ImageGlyph})}
    assert len(mappers) == 2  # what is occupied, and what is not known
    assert all(mapper.palette[0] == "#00000000" for mapper in mappers)  # free ground is the page's


def test_the_command_writes_a_file(tmp_path, capsys):
    path = tmp_path / "new" / "two.html"
    assert main(["watch", "--policy", "bearing", "proportional", "--seed", "3", "--html", str(path)]) == 0
    assert f"{path.stat().st_size:,} bytes" in capsys.readouterr().out
    page = path.read_text(encoding="utf-8")
    assert "TurtleBotNav-v0, seed 3" in page
    assert page.count("success after") == page.count("time is up after") == 1  # one steers to the bearing, the other does not


def test_without_a_file_a_browser_shows_a_temporary_one(tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    assert main(["watch", "--seed", "3"]) == 0
    (path,) = tmp_path.rglob("*.html")
    assert opened == [path.as_uri()]


def test_a_missing_bokeh_is_named_with_the_remedy(tmp_path, capsys, monkeypatch):
    for name in [name for name in sys.modules if name.startswith(("bokeh", "turtlebot_gym_view."))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "bokeh", None)
    assert main(["watch", "--html", str(tmp_path / "a.html")]) == 2
    assert "turtlebot-gym[agents]" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("option", "value"),
    [("--policy", "nothing"), ("--env", "nothing"), ("--drive", "nothing"), ("--noise", "nothing"), ("--seed", "-1")],
)
def test_a_wrong_option_is_refused_in_one_line_and_nothing_is_written(option, value, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["watch", option, value, "--html", "a.html"]) == 2
    printed = capsys.readouterr()
    assert not printed.out
    assert printed.err.startswith("turtlebot-gym: ")
    assert printed.err.count("\n") == 1
    assert not list(tmp_path.iterdir())
