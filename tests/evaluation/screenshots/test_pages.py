"""Screenshots of both pages in headless Chromium."""

import subprocess
import sys

import numpy as np
import pytest
from avatars import ball_avatar

import carigs
from carigs.errors import CarigsError
from carigs.library import HeadAvatar
from carigs.splat.avatar import save_avatar
from evaluation.screenshots import chromium
from evaluation.screenshots.chromium import CHROMIUM, WEBGL, Browser
from evaluation.screenshots.pages import SIZE, html_screenshot, viewer_screenshot

needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed (apt-get install chromium)")


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with Browser(tmp_path_factory.mktemp("profile"), WEBGL) as browser:
        yield browser


@pytest.mark.browser
@pytest.mark.slow
@needs_chromium
def test_the_html_page_shows_the_level(browser, tmp_path):
    carigs.write_html(HeadAvatar(ball_avatar()), tmp_path / "ball.html", regions=[])
    natural, caricature = (html_screenshot(browser, tmp_path / "ball.html", level) for level in (0.0, 0.25))
    assert natural.shape == caricature.shape == (SIZE[1], SIZE[0], 3)
    head = np.s_[:, : SIZE[0] // 2]
    assert np.ptp(natural[head], axis=(0, 1)).min() > 100
    assert np.abs(natural[head].astype(int) - caricature[head]).max() > 100
    assert not browser.problems()


@pytest.mark.browser
@pytest.mark.slow
@needs_chromium
def test_the_viewer_shows_both_heads_beside_a_divider(browser, tmp_path):
    pytest.importorskip("viser")
    save_avatar(tmp_path / "ball.npz", ball_avatar())
    image = viewer_screenshot(browser, tmp_path / "ball.npz", 0.25)
    assert image.shape == (SIZE[1], SIZE[0], 3)
    assert np.ptp(image[:, : SIZE[0] // 2], axis=(0, 1)).min() > 100
    red, _, blue = image.astype(int).transpose(2, 0, 1)
    assert (red - blue > 100).all(axis=0).any()  # the divider is orange, from top to bottom


def test_without_chromium_the_error_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setattr(chromium, "CHROMIUM", None)
    with pytest.raises(CarigsError, match="apt-get install chromium"):
        Browser(tmp_path)


def test_another_file_is_refused(tmp_path):
    (tmp_path / "a.txt").touch()
    command = [sys.executable, "-m", "evaluation.screenshots.pages", tmp_path / "a.txt", tmp_path / "b.png"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "expected an HTML page of an avatar, or an avatar (.npz)" in done.stderr
    assert len(done.stderr.splitlines()) == 1
