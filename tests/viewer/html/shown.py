"""The page of an avatar in a browser, beside our rasteriser."""

from __future__ import annotations

import json
import warnings
from pathlib import Path

import numpy as np

from carigs.capture import Camera
from carigs.library import HeadAvatar
from evaluation.screenshots.chromium import Browser, decoded


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    """PSNR in dB."""
    return float(-10 * np.log10(np.mean((a - b) ** 2)))


class Shown:
    """A page in a browser, and the avatar that it shows."""

    def __init__(self, browser: Browser, avatar: HeadAvatar, file: Path) -> None:
        self.browser, self.avatar = browser, avatar
        browser.open(file.as_uri(), 900, 600)
        self.session = browser.session
        self.value("carigs.ready")

    def value(self, expression: str):
        """The value of an expression in the page."""
        if self.browser.session != self.session:
            self.browser.session = self.session
            self.browser.call("Page.bringToFront")
        return self.browser.value(expression)

    def image(self, view: Camera, **state) -> np.ndarray:
        """The page's image of a camera."""
        rows = view.camera_from_world[:3].ravel().tolist()
        numbers = {name: getattr(view, name) for name in ("fx", "fy", "cx", "cy", "width", "height")}
        wanted = json.dumps({**state, "camera": {"rows": rows, **numbers}})
        return decoded(self.value(f"carigs.image({wanted})").partition(",")[2]) / 255

    def error(self, view: Camera, **state) -> float:
        """PSNR of the page against our rasteriser in dB."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # levels beyond the path
            ours = self.avatar.render(view, **state)
        assert np.ptp(ours, axis=(0, 1)).min() > 0.3
        return psnr(self.image(view, **state), np.rint(255 * ours) / 255)
