"""The page in headless Chromium: gamma moves the head, in both modes, and exact mode shows our rasteriser's image."""

from __future__ import annotations

import time

import numpy as np
import pytest
from avatars import ball_avatar

pytest.importorskip("viser")

from carigs.library import HeadAvatar
from carigs.viewer.exact_mode import exact_image, page_pose
from carigs.viewer.listening import listen
from carigs.viewer.scene import HeadScene
from carigs.viewer.server import Viewer
from carigs.viewer.subject import Subject
from evaluation.screenshots.chromium import CHROMIUM, WEBGL, Browser
from evaluation.screenshots.pages import choose, enter_level

pytestmark = [
    pytest.mark.browser,
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed (apt-get install chromium)"),
]
WIDTH, HEIGHT = 720, 400
SLIDERS = "[...document.querySelectorAll('[role=slider]')]"


@pytest.fixture(scope="module")
def viewer(tmp_path_factory):
    viewer = Viewer(Subject(HeadAvatar(ball_avatar(sh_degree=0))), tmp_path_factory.mktemp("exports"), listen(port=0))
    yield viewer
    viewer.stop()


@pytest.fixture(scope="module")
def page(viewer, tmp_path_factory):
    browser = Browser(tmp_path_factory.mktemp("profile"), WEBGL)
    browser.open(f"http://127.0.0.1:{viewer.port}/?fixedDpr=1", WIDTH, HEIGHT)  # fixedDpr: not coarser
    until(lambda: browser.value(f"{SLIDERS}.length") and viewer.num_clients == 1)
    until(lambda: session_of(viewer).view.width < WIDTH)  # the panel stands beside the image
    browser.value("document.querySelector('.mantine-Notification-closeButton')?.click()")  # "software WebGL"
    yield browser
    browser.close()


def until(condition, seconds=60.0):
    end = time.monotonic() + seconds
    while not (result := condition()):
        assert time.monotonic() < end, "it did not come"
        time.sleep(0.1)
    return result


def session_of(viewer):
    (panel,) = viewer._panels.values()
    return panel.session


def move_gamma(page, viewer, level):
    """Write a level into the field beside the slider."""
    enter_level(page, level)
    session = session_of(viewer)
    until(lambda: abs(session.state.values["level"] - level) < 1e-6)


def canvas(page, view):
    return page.pixels()[: view.height, : view.width] / 255


def psnr(image, expected):
    """Without the columns on which the panel throws its shadow."""
    return -10 * np.log10(np.square(image - expected)[:, :-12].mean())


def expected_image(viewer):
    session, scene = session_of(viewer), HeadScene(viewer.subject.avatar)
    camera = session.view.camera()
    return exact_image(scene.surfels(session.state.values, camera.centre), camera, 1.0)


def test_splats_follow_gamma(page, viewer):
    view = session_of(viewer).view
    until(lambda: canvas(page, view).std() > 0.05)
    before = canvas(page, view)
    exaggerated = expected_image(viewer)
    assert psnr(before, exaggerated) > 20  # close to our rasteriser, not the same
    move_gamma(page, viewer, 0.0)
    natural = expected_image(viewer)
    assert psnr(natural, exaggerated) < 20
    until(lambda: psnr(canvas(page, view), natural) > 20)


def test_exact_mode_shows_the_rasterisers_image(page, viewer):
    choose(page, "mode", "exact")
    session = session_of(viewer)
    until(lambda: session.options.mode == "exact")
    (panel,) = viewer._panels.values()
    camera = viewer.subject.first_camera()
    _, position, _ = page_pose(camera)
    for azimuth in (0.0, 0.7, -0.5):
        x, y, z = position
        turned = np.array([np.cos(azimuth) * x + np.sin(azimuth) * z, y, np.cos(azimuth) * z - np.sin(azimuth) * x])
        panel._client.camera.position = turned
        panel._client.camera.look_at = (0.0, 0.0, 0.0)
        until(lambda turned=turned: np.abs(np.array(session.view.position) - turned).max() < 0.1)
        for level in (0.0, 0.1, 0.25):
            move_gamma(page, viewer, level)
            until(lambda: psnr(canvas(page, session.view), expected_image(viewer)) >= 45)


def test_the_page_asks_nothing_of_the_network(page, viewer):
    asked = {event["request"]["url"] for event in page.named("Network.requestWillBeSent")}
    assert asked
    assert not [url for url in asked if not url.startswith((f"http://127.0.0.1:{viewer.port}/", "data:", "blob:"))]
    assert not page.named("Runtime.exceptionThrown")
