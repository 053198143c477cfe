"""The page in headless Chromium: the slider shows the images of its level, and nothing is asked from a network."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from report_pages import COLOURS, HOSTILE, report

from evaluation.report.page import report_page
from evaluation.screenshots.chromium import CHROMIUM, Browser

pytestmark = [
    pytest.mark.browser,
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed (apt-get install chromium)"),
]


@pytest.fixture(scope="module")
def browser(tmp_path_factory) -> Iterator[Browser]:
    browser = Browser(tmp_path_factory.mktemp("profile"))
    yield browser
    browser.close()


@pytest.fixture(scope="module")
def opened(browser, tmp_path_factory) -> Browser:
    page = tmp_path_factory.mktemp("page") / "report.html"
    page.write_text(report_page(report(HOSTILE)), encoding="utf-8")
    browser.open(page.as_uri(), 1200, 900)
    return browser


def shown_colours(browser: Browser) -> set[str]:
    """The levels whose plain colour covers a part of the window as large as their image."""
    browser.value("document.querySelector('[data-strip]').scrollIntoView()")
    pixels = browser.pixels().astype(float) / 255
    return {level for level, colour in COLOURS.items() if (np.abs(pixels - colour).max(axis=2) < 0.1).sum() > 1000}


def test_the_slider_shows_the_images_of_its_level(opened):
    assert shown_colours(opened) == {"0.25"}
    opened.value("document.querySelector('[data-strip] input').focus()")
    for key, level in (("ArrowLeft", "0.1"), ("Home", "0"), ("End", "0.25")):
        opened.press(key)
        assert shown_colours(opened) == {level}
        assert opened.value("document.querySelector('[data-strip] output').textContent") == level
        assert opened.value("document.querySelector('[data-strip] input').getAttribute('aria-valuetext')").endswith(
            level
        )


def test_nothing_is_asked_from_a_network_and_nothing_hostile_runs(opened):
    assert "file" in opened.schemes()
    assert opened.schemes() <= {"file", "data"}
    assert not opened.named("Page.javascriptDialogOpening")
    assert not opened.problems()


def test_in_print_all_levels_are_shown_and_no_slider(opened):
    opened.call("Emulation.setEmulatedMedia", media="print")
    try:
        assert shown_colours(opened) == set(COLOURS)
        assert opened.value("getComputedStyle(document.querySelector('.slider')).display") == "none"
    finally:
        opened.call("Emulation.setEmulatedMedia", media="")


@pytest.mark.parametrize("width", [1200, 800, 360])  # 800: a window of 1200 pixels at 150 %
def test_the_page_never_scrolls_sideways(opened, width):
    opened.call("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=False)
    assert opened.value("document.documentElement.scrollWidth") <= width
