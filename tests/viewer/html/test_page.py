"""The page of an avatar in headless Chromium: its images are those of our rasteriser, and it asks for nothing."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from avatars import ball_avatar
from viewer.html.shown import Shown

import carigs
from carigs.capture import Camera, look_at
from carigs.errors import SettingsError
from carigs.library import HeadAvatar
from carigs.splat.rig.smooth_motion import SmoothMotion
from carigs.splat.rig.solid_motion import Solid
from evaluation.screenshots.chromium import CHROMIUM, WEBGL, Browser

SIZE = 160
VIEWS = ([0.15, 0.1, 0.6], [-0.5, -0.2, 0.3], [0.1, 0.4, -0.5])
"""Places of the camera in metres; it looks at the middle of the ball."""

browser_test = [
    pytest.mark.browser,
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed (apt-get install chromium)"),
]


def camera(place) -> Camera:
    half = SIZE / 2
    return Camera(look_at(np.array(place), np.zeros(3)), 1.6 * SIZE, 1.5 * SIZE, half - 3, half + 5, SIZE, SIZE)


def avatar_of(**options) -> HeadAvatar:
    return HeadAvatar(ball_avatar(**options))


def hairy(grows: bool) -> HeadAvatar:
    avatar = avatar_of(sh_degree=1)
    sequence = avatar.avatar.sequence
    scalp = sequence.head.face_region("scalp")
    share = np.linspace(0, 1, len(scalp))
    sequence.smooth = SmoothMotion(sequence.rig, scalp, grows, share)
    sequence.rig = sequence.rig.with_kept_size(~scalp & (np.arange(len(scalp)) % 2 == 0))
    return avatar


def with_solids() -> HeadAvatar:
    avatar = avatar_of(sh_degree=1)
    sequence = avatar.avatar.sequence
    solids = np.zeros(len(sequence.rig.faces), np.uint8)
    solids[::7], solids[3::7], solids[5::7] = Solid.UPPER_JAW, Solid.LOWER_JAW, Solid.BODY
    sequence.add_solids(solids)
    return avatar


def written(browser: Browser, avatar: HeadAvatar, file: Path, **options) -> Shown:
    carigs.write_html(avatar, file, **options)
    return Shown(browser, avatar, file)


@pytest.fixture(scope="module")
def browser(tmp_path_factory) -> Iterator[Browser]:
    browser = Browser(tmp_path_factory.mktemp("profile"), WEBGL)
    yield browser
    browser.close()


@pytest.fixture(scope="module")
def shown(browser, tmp_path_factory) -> Shown:
    return written(
        browser, avatar_of(sh_degree=2), tmp_path_factory.mktemp("page") / "ball.html", regions=["face", "neck"]
    )


class TestInTheBrowser:
    pytestmark = browser_test

    @pytest.mark.parametrize("view", VIEWS)
    @pytest.mark.parametrize("level", [0.0, 0.11, 0.25])
    def test_images_are_those_of_the_rasteriser(self, shown, level, view):
        assert shown.error(camera(view), level=level, timestep=0) > 40

    @pytest.mark.parametrize("state", [
        {"level": 0.2, "timestep": 2},
        {"level": 0.29, "timestep": 1},
        {"level": 0.0, "timestep": 1, "regions": {"face": 0.25}},
        {"level": 0.15, "timestep": 2, "regions": {"face": 0.1, "neck": 0.2}},
    ])  # fmt: skip
    def test_timesteps_and_regions_too(self, shown, state):
        assert shown.error(camera(VIEWS[0]), **state) > 38

    @pytest.mark.parametrize("options", [
        {"sh_degree": 0}, {"sh_degree": 3}, {"rotate_harmonics": False}, {"lit": False},
        {"skinning": "jacobian", "sh_degree": 0}, {"skinning": "similarity", "sh_degree": 1},
    ])  # fmt: skip
    def test_every_kind_of_avatar(self, browser, tmp_path, options):
        page = written(browser, avatar_of(**options), tmp_path / "other.html", regions=[])
        assert page.error(camera(VIEWS[0]), level=0.2, timestep=2) > 40
        assert not browser.problems()

    @pytest.mark.parametrize("grows", [False, True])
    def test_hair_moves_as_a_solid(self, browser, tmp_path, grows):
        page = written(browser, hairy(grows), tmp_path / "hair.html", regions=[])
        assert page.error(camera(VIEWS[0]), level=0.25, timestep=1) > 40

    def test_jaws_and_body_move_as_solids(self, browser, tmp_path):
        """Whole balls of triangles turn together: other images than without the solids, and those of the rasteriser."""
        page = written(browser, with_solids(), tmp_path / "solids.html", regions=[])
        assert page.error(camera(VIEWS[0]), level=0.25, timestep=1) > 40
        page.avatar.avatar.sequence.solids = None
        page.avatar.avatar.sequence._motions.clear()
        assert page.error(camera(VIEWS[0]), level=0.25, timestep=1) < 35

    def test_nothing_is_asked_for_and_nothing_fails(self, browser, tmp_path):
        page = written(browser, avatar_of(sh_degree=0), tmp_path / "alone.html", title="<script>alert(1)</script> & co")
        assert browser.schemes() <= {"file", "data", "blob"}
        assert not browser.problems()
        assert not browser.named("Page.javascriptDialogOpening")
        assert browser.value("document.title") == "<script>alert(1)</script> & co"
        assert page.value("document.getElementById('message').hidden")

    def test_the_slider_changes_the_window(self, shown):
        def difference(level):
            shown.value(f"carigs.set({{level: {level}}})")
            return shown.browser.pixels().astype(float)

        natural, caricature = difference(0), difference(0.25)
        again = difference(0)
        assert np.abs(natural - again).max() <= 1
        assert np.abs(natural - caricature).max() > 50

    def test_the_controls_follow_the_keyboard(self, shown):
        shown.value("carigs.set({level: 0.1})")
        shown.value("document.querySelector('#level input').focus()")
        for _ in range(3):
            shown.browser.press("ArrowRight")
        assert shown.value("carigs.state.level") == pytest.approx(0.1 + 3 * 0.0025)

    def test_mouse_and_fingers_turn_and_zoom(self, shown):
        shown.value("carigs.set({azimuth: 0, elevation: 0, zoom: 1})")
        mouse = {"button": "left", "buttons": 1, "clickCount": 1}
        for kind, x in (("mousePressed", 200), ("mouseMoved", 260), ("mouseReleased", 260)):
            shown.browser.call("Input.dispatchMouseEvent", type=kind, x=x, y=200, **mouse)
        assert shown.value("carigs.state.orbit.azimuth") < -10
        assert shown.value("carigs.state.orbit.elevation") == 0
        shown.browser.call("Input.dispatchMouseEvent", type="mouseWheel", x=200, y=200, deltaX=0, deltaY=-200)
        assert shown.value("carigs.state.orbit.zoom") > 1.2
        shown.value("carigs.set({zoom: 1})")
        for kind, spread in (("touchStart", 50), ("touchMove", 100), ("touchEnd", None)):
            fingers = [] if spread is None else [{"x": 200 + side * spread, "y": 200, "id": side} for side in (0, 1)]
            shown.browser.call("Input.dispatchTouchEvent", type=kind, touchPoints=fingers)
        assert shown.value("carigs.state.orbit.zoom") == pytest.approx(2, rel=0.05)
        shown.value("carigs.set({azimuth: 0, zoom: 1})")

    def test_the_clip_plays_until_it_is_paused(self, shown):
        shown.value("carigs.reset()")
        shown.value("document.getElementById('play').click()")
        places, stop = set(), time.monotonic() + 20
        while len(places) < 3 and time.monotonic() < stop:
            places.add(shown.value("carigs.state.place"))
        assert places == {0, 1, 2}
        shown.value("document.getElementById('play').click()")
        assert not shown.value("carigs.playing")
        assert shown.value("document.getElementById('play').textContent") == "Play"

    @pytest.mark.parametrize("width", [1400, 390])
    def test_the_page_fits_its_window(self, shown, width):
        browser = shown.browser
        shown.value("0")
        browser.call("Emulation.setDeviceMetricsOverride", width=width, height=780, deviceScaleFactor=1, mobile=False)
        shown.value("carigs.set({})")
        assert browser.value("document.documentElement.scrollWidth") <= width
        assert browser.value("document.getElementById('view').clientHeight") > 300

    def test_without_webgl_there_is_a_picture(self, tmp_path_factory, tmp_path):
        carigs.write_html(avatar_of(sh_degree=0), tmp_path / "plain.html", regions=[])
        browser = Browser(tmp_path_factory.mktemp("plain"), "--disable-gpu --disable-3d-apis")
        try:
            browser.open((tmp_path / "plain.html").as_uri(), 900, 600)
            browser.value("carigs.ready")
            assert "WebGL" in browser.value("document.getElementById('message').textContent")
            assert not browser.value("document.getElementById('message').hidden")
            assert browser.value("document.getElementById('poster').naturalWidth") == 512
            assert np.ptp(browser.pixels()[:, :500], axis=(0, 1)).min() > 100
        finally:
            browser.close()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"timesteps": [0, 9]}, "timestep 9"),
        ({"timesteps": []}, "no timestep"),
        ({"regions": ["wing"]}, "wing"),
        ({"fps": 0.0}, "fps=0"),
        ({"level": float("nan")}, "level=nan"),
    ],
)
def test_what_the_avatar_does_not_have_is_refused(tmp_path, options, words):
    with pytest.raises(SettingsError, match=words):
        carigs.write_html(avatar_of(sh_degree=0), tmp_path / "page.html", **options)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_the_page_says_from_where_the_head_was_seen(tmp_path):
    avatar = avatar_of()
    for seen in ("", "3 cameras see the head from the front: nothing sees the nape"):
        avatar.avatar.seen = seen
        carigs.write_html(avatar, tmp_path / "page.html")
        text = (tmp_path / "page.html").read_text("utf-8")
        assert (f"In training, {seen}." in text) == ("In training," in text) == bool(seen)


def test_equal_avatars_give_equal_bytes(tmp_path):
    pages = []
    for name in ("a", "b"):
        carigs.write_html(avatar_of(sh_degree=1), tmp_path / f"{name}.html", title="page")
        pages.append((tmp_path / f"{name}.html").read_bytes())
    assert pages[0] == pages[1]
