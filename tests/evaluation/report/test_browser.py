"""The page in headless Chromium: the slider shows the images of its level, and nothing is asked from a network."""

from __future__ import annotations

import base64
import json
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from report_pages import COLOURS, HOSTILE, report

from evaluation.report.page import report_page

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome") or shutil.which("chromium-browser")
pytestmark = [
    pytest.mark.browser,
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed (apt-get install chromium)"),
]
OPTIONS = (
    "--headless --no-sandbox --disable-gpu --disable-dev-shm-usage --disable-background-networking "
    "--disable-component-update --disable-sync --no-first-run --remote-debugging-pipe"
)


class Browser:
    """Chromium's DevTools protocol over its pipe: JSON messages that end with a zero byte."""

    def __init__(self, profile: Path) -> None:
        read_commands, self.commands = os.pipe()
        self.messages, write_messages = os.pipe()
        options = [*OPTIONS.split(), f"--user-data-dir={profile}", "--host-resolver-rules=MAP * ~NOTFOUND"]
        command = f'exec 3<&{read_commands} 4>&{write_messages}; exec "$@"'
        self.process = subprocess.Popen(
            ["bash", "-c", command, "bash", CHROMIUM, *options],
            pass_fds=(read_commands, write_messages),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        os.close(read_commands)
        os.close(write_messages)
        self.buffer, self.number, self.session, self.events = b"", 0, None, []

    def call(self, method: str, **parameters) -> dict:
        """Send a command and wait for its answer; events that come before are kept."""
        self.number += 1
        message = {"id": self.number, "method": method, "params": parameters}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.commands, json.dumps(message).encode() + b"\0")
        while True:
            while b"\0" not in self.buffer:
                chunk = os.read(self.messages, 1 << 20)
                assert chunk, "Chromium has ended"
                self.buffer += chunk
            text, self.buffer = self.buffer.split(b"\0", 1)
            answer = json.loads(text)
            if answer.get("id") == self.number:
                assert "error" not in answer, answer
                return answer["result"]
            self.events.append(answer)

    def open(self, page: Path, width: int, height: int) -> None:
        """Open a page in a window, and record what it asks for."""
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Network", "Page", "Log", "Runtime"):
            self.call(f"{domain}.enable")
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        self.call("Page.navigate", url=page.as_uri())
        while self.value("document.readyState + location.protocol") != "completefile:":
            time.sleep(0.1)

    def value(self, expression: str):
        """The value of an expression in the page."""
        return self.call("Runtime.evaluate", expression=expression, returnByValue=True)["result"].get("value")

    def press(self, key: str) -> None:
        """Press a key."""
        code = {"ArrowLeft": 37, "Home": 36, "End": 35}[key]
        for kind in ("rawKeyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=code)

    def pixels(self) -> np.ndarray:
        """The window as RGB."""
        encoded = base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])
        return cv2.imdecode(np.frombuffer(encoded, np.uint8), cv2.IMREAD_COLOR)[:, :, ::-1]

    def named(self, event: str) -> list[dict]:
        """The events of a kind so far."""
        return [message["params"] for message in self.events if message.get("method") == event]


@pytest.fixture(scope="module")
def browser(tmp_path_factory) -> Iterator[Browser]:
    browser = Browser(tmp_path_factory.mktemp("profile"))
    yield browser
    os.killpg(browser.process.pid, signal.SIGKILL)
    browser.process.wait()


@pytest.fixture(scope="module")
def opened(browser, tmp_path_factory) -> Browser:
    page = tmp_path_factory.mktemp("page") / "report.html"
    page.write_text(report_page(report(HOSTILE)), encoding="utf-8")
    browser.open(page, 1200, 900)
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
    asked = {event["request"]["url"].split(":")[0] for event in opened.named("Network.requestWillBeSent")}
    assert "file" in asked
    assert asked <= {"file", "data"}
    assert not opened.named("Page.javascriptDialogOpening")
    assert not [event for event in opened.named("Log.entryAdded") if event["entry"]["level"] == "error"]
    assert not opened.named("Runtime.exceptionThrown")


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
