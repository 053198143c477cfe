"""Motions of the page: its images are those of the driven avatar, in step with the sound."""

from __future__ import annotations

import wave
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from avatars import ball_avatar
from viewer.html.shown import Shown, psnr

import carigs
from carigs.capture import Camera, look_at
from carigs.errors import InputError, SettingsError
from carigs.library import HeadAvatar
from carigs.motion import Motion
from carigs.motion.editing import looped, mirrored, resampled
from evaluation.screenshots.chromium import CHROMIUM, WEBGL, Browser

VIEW = Camera(look_at(np.array([0.15, 0.1, 0.6]), np.zeros(3)), 256, 240, 77, 85, 160, 160)


def browser_test(test):
    missing = pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed (apt-get install chromium)")
    return pytest.mark.browser(pytest.mark.slow(missing(test)))


@pytest.fixture(scope="module")
def browser(tmp_path_factory) -> Iterator[Browser]:
    browser = Browser(tmp_path_factory.mktemp("profile"), WEBGL)
    yield browser
    browser.close()


def avatar_of(**options) -> HeadAvatar:
    return HeadAvatar(ball_avatar(**options))


@pytest.fixture(scope="module")
def page(browser, tmp_path_factory) -> Shown:
    avatar = avatar_of(sh_degree=1)
    sound = tmp_path_factory.mktemp("sound") / "beep.wav"
    with wave.open(str(sound), "wb") as file:
        file.setparams((1, 2, 8000, 0, "NONE", ""))
        file.writeframes((8000 * np.sin(np.arange(24_000) / 3)).astype("<i2").tobytes())
    motion = resampled(avatar.captured_motion(2.0), 10.0)
    folder = tmp_path_factory.mktemp("clips")
    motions = {
        "it's a take": looped(motion, 3.0),
        "back": mirrored(replace(motion, expression=0 * motion.expression)),
    }
    file, sounds = folder / "clips.html", {"it's a take": sound}
    carigs.write_html(avatar, file, regions=[], motions=motions, sounds=sounds)
    return Shown(browser, avatar, file)


@browser_test
@pytest.mark.parametrize("level", [0.0, 0.17])
@pytest.mark.parametrize("frame", [0, 7])
def test_frames_of_a_clip_are_those_of_the_driven_avatar(page, frame, level):
    motion = looped(resampled(page.avatar.captured_motion(2.0), 10.0), 3.0)
    head = list(page.avatar.animate(motion, level))[frame]
    ours = np.rint(255 * head.render(VIEW)) / 255
    assert psnr(page.image(VIEW, level=level, clip="it's a take", frame=frame), ours) > 38


@browser_test
def test_sliders_add_to_what_is_shown(page):
    still = page.image(VIEW, clip=None, timestep=0, level=0.1)
    name = page.value("carigs.header.sliders[0].name")
    moved = page.image(VIEW, timestep=0, level=0.1, drive={name: 1.0})
    column = int(name.split()[1]) if name.startswith("expression") else 0
    expression = page.avatar.avatar.sequence.parameters[0].expression.copy()
    expression[column] += 1
    ours = page.avatar.render(VIEW, timestep=0, level=0.1, expression=list(expression))
    assert psnr(moved, np.rint(255 * ours) / 255) > 38 > psnr(still, np.rint(255 * ours) / 255)


@browser_test
def test_a_clip_plays_in_step_with_its_sound(page):
    page.value('carigs.set({clip: "it\'s a take", frame: 0})')
    page.value(
        "window.heard = []; window.show = carigs.showFrame.bind(carigs); carigs.showFrame = (frame) => {"
        "heard.push([document.querySelector('audio').currentTime, frame]); return show(frame); }; 1"
    )
    page.browser.call("Runtime.evaluate", expression="carigs.play(); 1", userGesture=True)  # sound needs a click
    page.browser.wait_for("heard.length >= 6")
    page.value("(carigs.pause(), delete carigs.showFrame, 1)")
    assert page.value("document.querySelector('audio').paused")
    seconds, frames = np.array(page.value("heard")).T
    # Each frame is the one that is due when it is chosen, to the 50 ms; how long it takes to draw is another matter.
    late = seconds - frames / 10
    assert seconds.max() > 0.3 and late.min() > -0.05 and late.max() < 0.1 + 0.05


@browser_test
def test_the_sound_starts_again_with_the_clip(page):
    """Also where a frame takes so long that the sound ends before it is drawn."""
    page.value('carigs.set({clip: "it\'s a take", frame: 27})')
    page.value(
        "window.rounds = 0; window.show = carigs.showFrame.bind(carigs); carigs.showFrame = async (frame) => {"
        "window.rounds += frame < carigs.shownFrame; "
        "await new Promise((resolve) => setTimeout(resolve, frame > 27 ? 600 : 0)); return show(frame); }; 1"
    )
    page.browser.call("Runtime.evaluate", expression="carigs.play(); 1", userGesture=True)
    page.browser.wait_for("rounds > 0")
    sound = page.value(
        "(({ ended, paused, currentTime }) => [ended, paused, currentTime])(document.querySelector('audio'))"
    )
    page.value("(carigs.pause(), delete carigs.showFrame, 1)")
    assert sound[:2] == [False, False] and sound[2] < 2


@browser_test
def test_the_toggle_shows_the_natural_head_and_the_caricature_again(page):
    page.value("carigs.set({level: 0.2})")
    page.value("carigs.toggle()")
    assert page.value("carigs.state.level") == 0
    page.value("carigs.toggle()")
    assert page.value("carigs.state.level") == 0.2


@browser_test
def test_the_background_has_the_chosen_colour(page):
    page.value("carigs.set({background: '#336699'})")
    corner = page.image(VIEW, level=0.0)[0, 0]
    page.value("carigs.set({background: '#ffffff'})")
    np.testing.assert_allclose(255 * corner, [0x33, 0x66, 0x99], atol=1)


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"sounds": {"wave": "a.wav"}}, "there is no motion wave"),
        ({"motions": {"a": Motion(30.0, ("tongueOut",), np.ones((2, 1)))}}, "none of the expressions tongueOut"),
    ],
)
def test_motions_and_sounds_that_are_not_possible(tmp_path, options, problem):
    with pytest.raises(SettingsError, match=problem):
        carigs.write_html(avatar_of(sh_degree=0), tmp_path / "a.html", regions=[], **options)
    assert not list(tmp_path.iterdir())


def test_a_sound_of_another_format_is_refused(tmp_path):
    avatar = avatar_of(sh_degree=0)
    (tmp_path / "a.txt").write_text("la")
    motions = {"a": avatar.captured_motion()}
    for name, problem in (("a.txt", "a sound is one of"), ("b.wav", "no such sound")):
        with pytest.raises(InputError, match=problem):
            carigs.write_html(avatar, tmp_path / "a.html", motions=motions, sounds={"a": tmp_path / name})
