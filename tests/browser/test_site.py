"""The documentation in a real browser: each page at 1400 and 400 pixels, light and dark.

``SITE`` names a folder with the built site; without it the site is built. Where ``SCREENSHOTS`` names a folder, a picture of
each page is left there, with a list of all addresses that the pages asked for.
"""

import functools
import http.server
import json
import os
import re
import threading
from pathlib import Path
from typing import NamedTuple
from urllib.parse import urlsplit

import pytest

ROOT = Path(__file__).parents[2]

pytestmark = pytest.mark.browser
WIDTHS = {"wide": 1400, "narrow": 400}
HEIGHT = 900
TALLEST = 20_000
"""No page is longer than this at 1400 pixels, px."""
API = "turtlebot_gym"
"""Pages of the API begin with it. They are all alike: they are looked at light only, and pictures are kept of a few."""

OVERFLOWING = """() => {
    const root = document.documentElement, wide = root.clientWidth, found = []
    if (root.scrollWidth > wide) found.push(`the page is ${root.scrollWidth} px wide`)
    const told = (one) => `${one.tagName} "${(one.getAttribute("src") || one.textContent).trim().slice(0, 40)}"`
    const parts = ".md-content :is(p, li, dd, h1, h2, h3, h4, pre, table, img, math, iframe, code)"
    for (const one of document.querySelectorAll(parts)) {
        const box = one.getBoundingClientRect()
        if (box.width === 0 || box.height === 0 || one.closest("template, [hidden], .md-source-file")) continue
        let scrolls = null  // the outermost box that the reader can scroll, which may hold what is wider
        for (let each = one; each; each = each.parentElement) {
            if (["auto", "scroll"].includes(getComputedStyle(each).overflowX) && each.matches(".md-content *")) scrolls = each
        }
        const edge = scrolls ? scrolls.getBoundingClientRect() : box
        if (edge.right > wide + 1 || edge.left < -1) found.push(`${told(one)} ends at ${Math.round(edge.right)} px`)
        if (!scrolls && one.scrollWidth > one.clientWidth + 1 && getComputedStyle(one).overflowX === "hidden")
            found.push(`${told(one)} is cut off`)
    }
    return found
}"""
"""What is wider than the page, or cut off without a way to scroll to it."""
PICTURES = """async () => {
    const shown = [...document.querySelectorAll(".md-content img")].filter((one) => getComputedStyle(one).display !== "none")
    for (const one of shown) one.loading = "eager"
    const late = new Promise((done) => setTimeout(done, 20000))  // a picture that never comes is one that is not there
    await Promise.all(shown.map((one) => Promise.race([late, one.decode().catch(() => null)])))
    return shown.filter((one) => !one.naturalWidth).map((one) => one.src)
}"""
"""Pictures that are not there."""
CUT = """() => [...document.querySelectorAll(".md-content .highlight:not(.output) pre")]
    .filter((one) => one.scrollWidth > one.clientWidth + 1 || one.firstElementChild?.scrollWidth > one.clientWidth + 1)
    .map((one) => one.textContent.trim().slice(0, 60))"""
"""Commands and code of which a part is beyond the edge."""
CROPPED = """() => [...document.querySelectorAll(".md-content figure img")]
    .filter((one) => one.getBoundingClientRect().right > document.documentElement.clientWidth + 1).map((one) => one.src)"""
"""Figures that are not whole."""
LINES = """() => [...document.querySelectorAll(".md-content table:not([class]) td.number")].filter((one) => {
    const style = getComputedStyle(one)
    return one.clientHeight && one.firstChild && (() => {
        const range = document.createRange()
        range.selectNodeContents(one)
        return new Set([...range.getClientRects()].map((each) => Math.round(each.top))).size > 1
    })()
}).map((one) => one.textContent)"""
"""Numbers in tables that are broken into lines."""


SHOWN = "scheme => document.body.dataset.mdColorScheme === {light: 'default', dark: 'slate'}[scheme]"
"""Whether the page has taken the scheme of the browser."""


class Seen(NamedTuple):
    """What was found on a page."""

    overflowing: dict[str, list[str]]
    """By width and scheme."""
    missing: list[str]
    broken: list[str]
    cut: list[str]
    cropped: list[str]
    errors: list[str]
    outside: list[str]
    inside: list[str]
    height: int
    formulas: int
    dollars: bool
    ground: dict[str, str]


@pytest.fixture(scope="module")
def server(site):
    """Address of the site on this machine."""

    class Handler(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_):
            """Say nothing."""

    listening = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Handler, directory=str(site)))
    threading.Thread(target=listening.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{listening.server_port}"
    listening.shutdown()
    listening.server_close()


class Visitor:
    """A tab of the browser that may speak to one server only; it keeps what is asked for and complained of."""

    def __init__(self, browser, server):
        self.server = server
        self.page = browser.new_page(viewport={"width": WIDTHS["wide"], "height": HEIGHT})
        self.asked, self.errors = [], []
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("console", lambda message: self.errors.append(message.text) if message.type == "error" else None)
        self.page.route(lambda url: self._outside(url), lambda route: route.abort())

    def _outside(self, url):
        return urlsplit(url).scheme not in ("data", "blob") and not url.startswith(f"{self.server}/")

    def open(self, path):
        self.asked.clear()
        self.errors.clear()
        self.page.set_viewport_size({"width": WIDTHS["wide"], "height": HEIGHT})
        self.page.emulate_media(color_scheme="light")
        self.page.goto(f"{self.server}/{path}")

    def look(self, name, folder, schemes=("light", "dark")):
        """Go through widths and schemes, and return what is found; keep two pictures if there is a folder for them."""
        overflowing, missing, ground = {}, [], {}
        cut, cropped = [], []
        height = self.page.evaluate("document.documentElement.scrollHeight")
        for size, width in WIDTHS.items():
            self.page.set_viewport_size({"width": width, "height": HEIGHT})
            for scheme in schemes:
                self.page.emulate_media(color_scheme=scheme)
                self.page.wait_for_function(SHOWN, arg=scheme)
                missing += self.page.evaluate(PICTURES)
                cut += self.page.evaluate(CUT)
                cropped += self.page.evaluate(CROPPED)
                overflowing[f"{size}, {scheme}"] = self.page.evaluate(OVERFLOWING)
                ground[scheme] = self.page.evaluate("getComputedStyle(document.body).backgroundColor")
                if folder is not None and (size, scheme) in (("wide", "light"), ("narrow", schemes[-1])):
                    self.page.screenshot(path=folder / f"{name}-{size}-{scheme}.png", full_page=True)
        return Seen(
            overflowing={scheme: elements for scheme, elements in overflowing.items() if elements},
            missing=missing,
            broken=self.page.evaluate(LINES),
            cut=cut,
            cropped=cropped,
            errors=list(self.errors),
            outside=[url for url in self.asked if self._outside(url)],
            inside=[url for url in self.asked if not self._outside(url)],
            height=height,
            formulas=self.page.locator(".md-content math").count(),
            dollars="$$" in self.page.inner_text(".md-content") or self.page.locator(".md-content .arithmatex").count() > 0,
            ground=ground,
        )


@pytest.fixture(scope="module")
def visitor(browser, server):
    return Visitor(browser, server)


@pytest.fixture(scope="module")
def seen(site, visitor):
    """What is found on each page of the site."""
    folder = Path(os.environ["SCREENSHOTS"], "site") if os.environ.get("SCREENSHOTS") else None
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
    pages, count = {}, 0
    for path in sorted(site.rglob("*.html")):
        name = path.relative_to(site).as_posix()
        if name.startswith("gallery/") or name == "404.html":  # views of drives, tested by test_watch.py
            continue
        count += path.name.startswith(API)
        of_api = path.name.startswith(API)
        kept = folder if not of_api or count % 20 == 1 else None
        visitor.open(name)
        flat = name.removesuffix(".html").replace("/", "-")
        pages[name] = visitor.look(flat, kept, ("light",)) if of_api else visitor.look(flat, kept)
    if folder is not None:
        asked = {name: sorted({urlsplit(url).path for url in page.inside}) for name, page in pages.items()}
        requests = {"outside": sorted({url for page in pages.values() for url in page.outside}), "inside": asked}
        (folder / "requests.json").write_text(json.dumps(requests, indent=1))
        (folder / "seen.json").write_text(json.dumps({name: page._asdict() for name, page in pages.items()}, indent=1))
    assert len(pages) > 40
    return pages


WRONG = {
    "is wider than the page": lambda one: one.overflowing,
    "asks anybody else": lambda one: one.outside,
    "complains": lambda one: one.errors,
    "lacks a picture": lambda one: one.missing,
    "breaks a number in a table": lambda one: one.broken,
    "cuts code off": lambda one: one.cut,
    "crops a figure": lambda one: one.cropped,
    "is too long": lambda one: one.height > TALLEST,
    "shows a formula's source": lambda one: one.dollars,
    "was not asked for": lambda one: not one.inside,
}


@pytest.mark.parametrize("what", WRONG)
def test_no_page_has_a_fault(what, seen):
    assert not {name: wrong for name, page in seen.items() if (wrong := WRONG[what](page))}


def test_formulas_are_mathml(seen):
    assert seen["concepts/belief.html"].formulas > 5


def test_pages_are_light_and_dark(seen):
    for name, page in seen.items():
        lightness = {scheme: sum(map(int, ground.strip("rgba()").split(",")[:3])) for scheme, ground in page.ground.items()}
        assert lightness["light"] > 700, name
        assert lightness.get("dark", 0) < 200, name


def test_the_views_of_the_gallery_draw(visitor):
    visitor.open("gallery.html")
    views = visitor.page.locator("iframe.view")
    for at in range(views.count()):
        views.nth(at).scroll_into_view_if_needed()
        views.nth(at).content_frame.locator("html[data-ready]").wait_for(state="attached", timeout=60_000)
        canvas = views.nth(at).content_frame.locator(".map canvas").first
        assert canvas.bounding_box()["width"] > 100
    assert views.count() == 3
    assert not visitor.errors
    assert not [url for url in visitor.asked if visitor._outside(url)]


@pytest.mark.parametrize(
    ("added", "noticed"),
    [
        ("<table class='x'><tr><td style='min-width: 2000px'>wide</td></tr></table>", "overflowing"),
        ("<p style='overflow: hidden; white-space: nowrap'>" + "cut " * 400 + "</p>", "overflowing"),
        ("<img src='nowhere.png'>", "missing"),
        ("<figure><img style='width: 2000px; max-width: none; height: 1px'></figure>", "cropped"),
        ("<div class='highlight'><pre style='white-space: pre'>" + "long " * 400 + "</pre></div>", "cut"),
        ("<img src='https://example.org/picture.png'>", "outside"),
    ],
)
def test_what_is_wrong_is_noticed(visitor, added, noticed):
    visitor.open("limits.html")
    visitor.page.evaluate("html => document.querySelector('.md-content article').insertAdjacentHTML('beforeend', html)", added)
    visitor.page.wait_for_timeout(300)
    assert getattr(visitor.look("", None), noticed)


def test_the_search_finds_a_word_in_pages_that_are_files(browser, site):
    page, asked, errors = browser.new_page(viewport={"width": 1400, "height": 900}), [], []
    page.on("request", lambda request: asked.append(request.url))
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto((site / "index.html").as_uri())
    page.click("[data-md-component=search-query]")
    for word in ("UKF", "gyro", "AMCL", "RViz", "VecNormalize", "covariance"):
        for typed, answer in (("wheelbarrow", r"^\s*No matching document"), (word, r"^\s*\d+ matching document")):
            page.keyboard.press("Control+A")
            page.keyboard.type(typed)
            page.locator(".md-search-result__meta", has_text=re.compile(answer)).wait_for(timeout=60_000)
    page.locator(".md-search-result__item a").first.wait_for()
    first = page.locator(".md-search-result__item a").first
    first.click()
    page.wait_for_load_state()
    assert page.url.startswith(site.as_uri())
    assert "covariance" in page.inner_text(".md-content").casefold()
    assert not [url for url in asked if urlsplit(url).scheme not in ("file", "data", "blob", "about")]
    assert not errors
    page.close()


def test_the_drive_on_the_first_page_plays(browser, site):
    page = browser.new_page(viewport={"width": 1400, "height": 1000})
    page.goto((site / "index.html").as_uri())
    view = page.locator("iframe.view").content_frame
    view.locator("html[data-ready]").wait_for(state="attached", timeout=60_000)
    view.locator("#play").click()
    view.locator("#clock").get_by_text(re.compile(r"^[1-9]\.\d / ")).wait_for(timeout=20_000)
    page.close()


def touched(page):
    """Play the drive of a page, zoom into it by ten notches, and drag it; return the clock and the map's picture before."""
    view = page.locator("iframe.view").first.content_frame
    view.locator("html[data-ready]").wait_for(state="attached", timeout=60_000)
    canvas = view.locator(".map canvas").first
    before = canvas.screenshot()
    box = canvas.bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    for _ in range(10):
        page.mouse.wheel(0, -100)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] / 2 + 40, box["y"] + box["height"] / 2 + 20, steps=4)
    page.mouse.up()
    page.wait_for_timeout(300)
    return before, canvas.screenshot()


@pytest.mark.parametrize("width", WIDTHS.values())
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_drive_on_the_first_page_is_touched(visitor, width, scheme):
    visitor.open("index.html")
    visitor.page.set_viewport_size({"width": width, "height": HEIGHT})
    visitor.page.emulate_media(color_scheme=scheme)
    before, after = touched(visitor.page)
    assert before != after
    assert visitor.page.locator("iframe.view").content_frame.locator(".map canvas").first.bounding_box()["height"] > 200
    assert not visitor.errors
    assert not [url for url in visitor.asked if visitor._outside(url)]


def test_tables_of_results_are_folded_and_open(visitor):
    visitor.open("results.html")
    boxes = visitor.page.locator(".md-content details:has(table)")
    assert boxes.count() > 8
    assert visitor.page.locator(".md-content table:visible").count() == 0
    boxes.first.locator("summary").click()
    assert boxes.first.locator("table").is_visible()


def test_menus_have_a_place_for_limits_questions_and_words(visitor):
    visitor.open("index.html")
    for section, name in (("What it can do", "Limits"), ("Help", "FAQ"), ("Help", "Glossary")):
        inside = visitor.page.locator(".md-sidebar--primary .md-nav__item--section", has_text=section).last
        assert inside.get_by_role("link", name=name, exact=True).count() == 1, name
        visitor.open("index.html")
        visitor.page.locator(".md-sidebar--primary").get_by_role("link", name=name, exact=True).click()
        assert visitor.page.locator("h1").inner_text().startswith(name if name != "FAQ" else "")


CONCEPTS = ("belief", "graph", "loop", "noises", "rooms", "safety", "tasks", "transfer")


def test_each_concept_has_an_equation_and_a_figure(seen, site):
    assert {path.stem for path in (site / "concepts").glob("*.html")} == {*CONCEPTS}
    for name in CONCEPTS:
        assert seen[f"concepts/{name}.html"].formulas > 0, name
        text = (site / "concepts" / f"{name}.html").read_text()
        assert '<figure class="picture">' in text, name
        assert 'display="block"' in text, name
