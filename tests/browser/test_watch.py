"""The viewer in a real browser: it opens, draws on screens and phones, plays, and asks for nothing.

Where ``SCREENSHOTS`` names a folder, pictures are left there, to be looked at.
"""

import io
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

pytest.importorskip("bokeh", reason="needs the extra [agents]")
pytest.importorskip("playwright")

from playwright import sync_api

from turtlebot_gym_agents.evaluation.recording import record_episode
from turtlebot_gym_view.page import Page

pytestmark = pytest.mark.slow
CHROMIUM = os.environ.get("CHROMIUM") or shutil.which("chromium") or shutil.which("google-chrome")
SIZES = {"wide": (1400, 900), "narrow": (400, 860)}


@pytest.fixture(scope="module")
def browser():
    if not CHROMIUM:
        pytest.skip("needs Chromium: apt-get install chromium")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """A folder for pictures."""
    folder = Path(os.environ.get("SCREENSHOTS") or tmp_path_factory.mktemp("browser"))
    folder.mkdir(parents=True, exist_ok=True)
    return folder


class Visit:
    """A page that was opened, and what it asked for and complained of meanwhile."""

    def __init__(self, browser, url, *, size="wide", scheme="light", motion="reduce"):
        width, height = SIZES[size]
        view = {"viewport": {"width": width, "height": height}, "color_scheme": scheme, "reduced_motion": motion}
        self.page = browser.new_page(**view)  # with reduced motion, nothing moves by itself
        self.requests, self.errors = [], []
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("websocket", lambda socket: self.requests.append(socket.url))
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("console", lambda message: self.errors.append(message.text) if message.type == "error" else None)
        self.page.goto(url)
        self.page.wait_for_selector("html[data-ready]", state="attached", timeout=60_000)
        self.page.wait_for_timeout(500)

    def seek(self, seconds):
        self.page.evaluate("t => window.watch.seek(t)", seconds)
        self.page.wait_for_timeout(200)

    def __getattr__(self, name):
        return self.page.evaluate(f"window.watch.{name}")

    def picture(self, selector=None):
        """Return the pixels of the page, or of a part of it."""
        shot = self.page.locator(selector).first.screenshot() if selector else self.page.screenshot()
        return np.asarray(Image.open(io.BytesIO(shot)).convert("RGB")).astype(int)

    def close(self):
        self.page.close()
        assert not self.errors


@pytest.fixture
def visit(browser):
    visits = []

    def open_(url, **options):
        visits.append(Visit(browser, url, **options))
        return visits[-1]

    yield open_
    for visit in visits:
        visit.close()


@pytest.fixture(scope="module")
def urls(tmp_path_factory):
    """Files of a drive of 60 s that does not find the way, alone and with another one of 60 s, by the number of drives."""
    drive = record_episode("vfh", env="turtlebot_gym/TurtleBotRooms-v0", seed=9, world="office")
    assert drive.time[-1] == pytest.approx(60.0)
    folder = tmp_path_factory.mktemp("file")
    for number in (1, 2):
        Page(drives=[drive] * number, title="TurtleBotRooms-v0, office, seed 9").save(folder / f"{number}.html")
    return {number: (folder / f"{number}.html").as_uri() for number in (1, 2)}


@pytest.mark.parametrize("drives", [1, 2])
def test_a_page_asks_for_nothing(visit, urls, drives):
    assert visit(urls[drives]).requests == [urls[drives]]


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_is_drawn_in_any_size_and_light(visit, urls, results, size, scheme):
    for name, url in urls.items():
        seen = visit(url, size=size, scheme=scheme)
        seen.seek(31.0)
        seen.page.screenshot(path=results / f"{name}-{size}-{scheme}.png", full_page=size == "narrow")
        picture = seen.picture()
        ground = np.median(picture.reshape(-1, 3), axis=0)
        assert (ground > 240).all() if scheme == "light" else (ground < 50).all()
        for part in (".map", ".plots"):
            colors = np.unique(seen.picture(part).reshape(-1, 3), axis=0)
            assert len(colors) > 30, f"{name}: {part} is blank"
        width = seen.page.evaluate("document.documentElement.scrollWidth")
        assert width <= SIZES[size][0], f"{name}: it is wider than the screen"


def test_it_plays_pauses_and_scrubs(visit, urls):
    seen = visit(urls[1])
    assert seen.time == 0.0
    before = seen.picture(".map")
    seen.page.select_option("#speed", "16")
    seen.page.click("#play")
    seen.page.wait_for_function("window.watch.time > 3", timeout=20_000)
    seen.page.click("#play")
    stood = seen.time
    seen.page.wait_for_timeout(300)
    assert seen.time == stood
    assert not seen.playing
    assert (seen.picture(".map") != before).any()
    seen.page.focus("#time")
    seen.page.keyboard.press("ArrowRight")
    assert seen.time == pytest.approx(stood + 0.1)
    seen.page.evaluate("() => {const s = document.getElementById('time'); s.value = 42; s.dispatchEvent(new Event('input'))}")
    assert seen.time == pytest.approx(42.0, abs=0.01)
    assert seen.page.inner_text("#clock") == "42.0 / 60.0 s"
    plot = seen.page.locator(".plot").first.locator("canvas").first.bounding_box()
    seen.page.mouse.click(plot["x"] + 0.5 * plot["width"], plot["y"] + 0.5 * plot["height"])
    seen.page.wait_for_function("window.watch.time < 40", timeout=5_000)
    assert 20.0 < seen.time < 40.0
    seen.seek(60.0)
    seen.page.keyboard.press("Space")  # from the end it plays again
    seen.page.wait_for_function("window.watch.time > 0 && window.watch.time < 55", timeout=5_000)
