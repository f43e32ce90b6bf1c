"""The report of a field test in a real browser: nothing is wider than the screen, text stands out, and nothing is asked for.

Where ``SCREENSHOTS`` names a folder, pictures are left there, to be looked at.
"""

import math
import os
from pathlib import Path

import numpy as np
import pytest

from turtlebot_gym_lab.field.findings import FINE, REFUSED, SKIPPED, WARNING, Figure, Finding
from turtlebot_gym_lab.field.report import page

pytestmark = pytest.mark.browser
FOUND = (
    Finding("/odom", FINE, "nav_msgs/msg/Odometry, reliable, from turtlebot3_node.", (Figure("rate", 20.0, "Hz"),)),
    Finding("clock of /odom", WARNING, "Its clock is 0.775 s ahead.", (Figure("lead", 0.775, "s"),), "Synchronize (chrony)."),
    Finding("wheels", REFUSED, f"They hear {'a_very_long_name_of_a_type/' * 6}Twist.", (), "Set enable_stamped_cmd_vel."),
    Finding("calibration", WARNING, "Fitted.", (Figure("marker_theta", -5.4646e-06, "rad²/m²", -5.2363e-06, -5.6933e-06),)),
    Finding("a turn", SKIPPED, "Nobody measured it.", (Figure("measured over odometry", 0.62031, "", 0.61234, 0.62876),)),
)
TURN = np.linspace(0.0, 2.0 * math.pi, 50)
PATH = np.stack([np.cos(TURN) - 1.0, np.sin(TURN)], axis=1)
CONTRASTS = """() => {
    const light = (colour) => {
        const [r, g, b] = colour.match(/[0-9.]+/g).slice(0, 3).map((part) => part / 255)
            .map((part) => part <= 0.04045 ? part / 12.92 : ((part + 0.055) / 1.055) ** 2.4)
        return 0.2126 * r + 0.7152 * g + 0.0722 * b
    }
    const ground = (element) => {
        const own = getComputedStyle(element).backgroundColor
        return own === "rgba(0, 0, 0, 0)" && element.parentElement ? ground(element.parentElement) : own
    }
    return [...document.querySelectorAll("h1, h2, p, td, span")].filter((each) => each.textContent.trim()).map((each) => {
        const [low, high] = [light(getComputedStyle(each).color), light(ground(each))].sort((a, b) => a - b)
        return (high + 0.05) / (low + 0.05)
    })
}"""
"""Contrasts of all texts with what is behind them, by WCAG 2."""


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "report.html"
    about = {"Robot": "burger", "Beside this page": "bag, noise.yaml"}
    path.write_text(page(FOUND, about=about, paths={"odometry": PATH, "the square": 0.8 * PATH}, scan=2.0 * PATH))
    return path


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1400, 400])
def test_the_report_is_readable(browser, report, width, scheme, tmp_path):
    visit, asked = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme), []
    visit.on("request", lambda request: asked.append(request.url))
    visit.on("pageerror", lambda error: pytest.fail(str(error)))
    visit.goto(report.as_uri())
    folder = Path(os.environ.get("SCREENSHOTS") or tmp_path)
    visit.screenshot(path=folder / f"field_test-{width}-{scheme}.png", full_page=True)
    assert asked == [report.as_uri()]
    assert visit.evaluate("document.documentElement.scrollWidth") <= width
    cards = visit.evaluate("[...document.querySelectorAll('section')].map((each) => each.scrollWidth - each.clientWidth)")
    assert max(cards) == 0
    assert [heading.inner_text() for heading in visit.query_selector_all("h2")][: len(FOUND)] == [
        finding.name for finding in FOUND
    ]
    assert min(visit.evaluate(CONTRASTS)) >= 4.5
    is_dark = visit.evaluate("getComputedStyle(document.body).backgroundColor") != "rgb(255, 255, 255)"
    assert is_dark == (scheme == "dark")
    cards = visit.evaluate("[...document.querySelectorAll('section')].map((each) => each.getBoundingClientRect().width)")
    assert max(cards) > 0.9 * min(width, 1100) - 40
    visit.close()
