"""Screenshots of the HTML page of an avatar (`carigs export`) and of the viewer (`carigs view`), in Chromium.

Example:
    python -m evaluation.screenshots.pages avatar.html page.png --level 0.25
    python -m evaluation.screenshots.pages avatar.npz viewer.png --level 0.25
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from carigs.errors import InputError
from carigs.system.files import writing
from evaluation.command_line import run
from evaluation.screenshots.chromium import WEBGL, Browser

SIZE = (1100, 700)
"""Width and height of the window in pixels."""
VIEW = {"azimuth": -32, "zoom": 1.25}
"""From where the HTML page shows the head."""
SETTLED = 2.0
"""Seconds that the viewer's image stays the same before it is taken."""
COMPARISON = "natural head"
"""What the viewer shows beyond the divider."""


def html_screenshot(browser: Browser, page: Path, level: float) -> UInt8[np.ndarray, "h w 3"]:
    """Open the HTML page of an avatar.

    Args:
        browser: Chromium with WebGL.
        page: The page.
        level: Exaggeration to show.

    Returns:
        RGB of the window.
    """
    browser.open(page.resolve().as_uri(), *SIZE)
    browser.value("carigs.ready")
    browser.value(f"carigs.set({json.dumps({'level': level, **VIEW})})")
    return settled(browser, 0.5)  # the page draws all pixels when the head stands still


def viewer_screenshot(browser: Browser, avatar: Path, level: float) -> UInt8[np.ndarray, "h w 3"]:
    """Start the viewer with an avatar, and compare the caricature with the natural head.

    Args:
        browser: Chromium with WebGL.
        avatar: The avatar (.npz).
        level: Exaggeration to show.

    Returns:
        RGB of the window.
    """
    from carigs.library import load
    from carigs.viewer.listening import listen
    from carigs.viewer.server import Viewer
    from carigs.viewer.subject import Subject

    with tempfile.TemporaryDirectory() as exports:
        viewer = Viewer(Subject(load(avatar)), Path(exports), listen(port=0))
        try:
            browser.open(f"http://127.0.0.1:{viewer.port}/?fixedDpr=1", *SIZE)
            browser.wait_for("document.querySelectorAll('[role=slider]').length > 0")
            browser.value("document.querySelector('.mantine-Notification-closeButton')?.click()")
            enter_level(browser, level)
            choose(browser, "compare with", COMPARISON)
            browser.value("document.activeElement?.blur()")
            return settled(browser, SETTLED)
        finally:
            viewer.stop()


def enter_level(browser: Browser, level: float) -> None:
    """Write a level into the viewer's field beside its first slider.

    Args:
        browser: Chromium with the viewer.
        level: Exaggeration.
    """
    slider = "document.querySelector('[role=slider]')"
    field = f"{slider}.closest('.mantine-Flex-root').querySelector('input[inputmode]')"
    browser.value(f"{slider}.scrollIntoView(), {field}.focus(), {field}.select()")
    browser.call("Input.insertText", text=f"{level:g}")


def choose(browser: Browser, label: str, option: str) -> None:
    """Choose an option of one of the viewer's dropdowns.

    Args:
        browser: Chromium with the viewer.
        label: Label of the dropdown.
        option: The option.
    """
    labels = f"[...document.querySelectorAll('label')].find(l => l.textContent === {json.dumps(label)})"
    browser.wait_for(f"!!{labels}")
    browser.value(f"{labels}.closest('div').parentElement.querySelector('input').click()")
    found = f"[...document.querySelectorAll('[role=option]')].find(o => o.textContent === {json.dumps(option)})"
    browser.wait_for(f"!!{found}")
    browser.value(f"{found}.click()")


def settled(browser: Browser, seconds: float, patience: float = 60.0) -> UInt8[np.ndarray, "h w 3"]:
    """Wait until the window no longer changes.

    Args:
        browser: Chromium.
        seconds: Time without a change.
        patience: Longest time to wait.

    Returns:
        RGB of the window.
    """
    image, since, end = browser.pixels(), time.monotonic(), time.monotonic() + patience
    while time.monotonic() - since < seconds and time.monotonic() < end:
        time.sleep(0.2)
        now = browser.pixels()
        if not np.array_equal(now, image):
            image, since = now, time.monotonic()
    return image


def main() -> None:
    """Take a screenshot from the command line.

    Raises:
        InputError: The file is neither a page nor an avatar.
    """
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("shown", type=Path, help="an HTML page of an avatar, or an avatar (.npz)")
    parser.add_argument("image", type=Path, help="PNG to write")
    parser.add_argument("--level", type=float, default=0.25, help="exaggeration to show (default: 0.25)")
    task = parser.parse_args()
    takers = {".html": html_screenshot, ".npz": viewer_screenshot}
    if task.shown.suffix not in takers or not task.shown.is_file():
        raise InputError("expected an HTML page of an avatar, or an avatar (.npz)", file=task.shown)
    with tempfile.TemporaryDirectory() as profile, Browser(Path(profile), WEBGL) as browser:
        pixels = takers[task.shown.suffix](browser, task.shown, task.level)
    with writing(task.image) as part:
        Image.fromarray(np.ascontiguousarray(pixels)).save(part, "PNG")


if __name__ == "__main__":
    run(main)
