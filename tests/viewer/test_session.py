"""What a client is shown after its events, without a browser."""

import numpy as np
import pytest
from avatars import ball_avatar, ball_sequence, random_surfels

from carigs.errors import SettingsError
from carigs.library import HeadAvatar
from carigs.splat.avatar import Avatar
from carigs.viewer.exact_mode import View, exact_image, pixels
from carigs.viewer.session import SETTLE_SECONDS, Session
from carigs.viewer.splat_records import splat_records
from carigs.viewer.subject import Subject

VIEW = View((0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 10.0), 0.6, 120, 80)


class Page:
    def __init__(self):
        self.splats = self.image = self.mesh = self.lossless = None
        self.status, self.shown, self.states = "", 0, 0

    def show_splats(self, records):
        self.splats, self.shown = records, self.shown + (records is not None)

    def show_image(self, image, lossless):
        self.image, self.lossless, self.shown = image, lossless, self.shown + (image is not None)

    def show_mesh(self, vertices):
        self.mesh = vertices

    def show_captured(self, image):
        pass

    def show_status(self, text):
        self.status = text

    def show_state(self):
        self.states += 1

    def show_frame(self, frame):
        self.frame = frame


def subject(second=False, sh_degree=3):
    other = Avatar(random_surfels(300, 320, seed=5), ball_sequence(lit=False))
    return Subject(HeadAvatar(ball_avatar(sh_degree=sh_degree)), HeadAvatar(other) if second else None)


@pytest.fixture(scope="module")
def two():
    return subject(second=True)


def shown(session, now=100.0):
    """The page when nothing moves any more."""
    while (now := session.step(now)) is not None:
        pass
    return session.page


def expected(session, values, camera, scene=0):
    world = session.subject.scenes[scene].surfels(values, camera.centre)
    return exact_image(world, camera, 1.0)


def test_nothing_is_shown_before_the_browser_has_a_camera_and_nothing_twice(two):
    session = Session(two, Page())
    session.set_value("level", 0.1)
    assert session.step(0.0) is None and session.page.shown == 0
    session.set_view(VIEW)
    due = session.step(1.0)
    assert due == 1.0 + SETTLE_SECONDS and session.page.shown == 1
    assert session.step(1.0 + SETTLE_SECONDS / 2) == due and session.page.shown == 1
    assert session.step(due) is None
    count = session.page.shown
    session.set_view(VIEW)
    assert session.step(50.0) is None and session.page.shown == count


def test_splats_follow_a_slider_and_the_light_follows_when_it_rests(two):
    session = Session(two, Page())
    session.set_view(VIEW)
    session.set_value("level", 0.2)
    records = shown(session).splats
    world = two.scenes[0].surfels(session.state.values, VIEW.camera().centre)
    np.testing.assert_array_equal(records, splat_records(world))
    session.set_options(overlay="mesh")
    page = shown(session)
    assert page.mesh is not None and page.splats.view(np.uint8)[:, 31].max() > 0
    assert page.splats.view(np.uint8)[:, 31].max() < records.view(np.uint8)[:, 31].max()


def test_exact_mode_is_small_while_it_moves_and_full_when_still(two):
    session = Session(two, Page())
    session.set_options(mode="exact")
    session.set_view(VIEW._replace(width=1200, height=800))
    due = session.step(1.0)
    page = session.page
    assert page.image.shape[0] < 800 and not page.lossless and page.splats is None
    assert session.step(due) is None
    assert page.image.shape == (800, 1200, 3) and page.lossless
    camera = session.view.camera()
    np.testing.assert_array_equal(page.image, pixels(expected(session, session.state.values, camera)))


def test_a_split_view_shows_two_variants(two):
    session = Session(two, Page())
    session.set_view(VIEW)
    session.set_value("level", 0.25)
    camera = VIEW.camera()
    left = pixels(expected(session, session.state.values, camera))
    natural = pixels(expected(session, {**session.state.values, "level": 0.0}, camera))
    for split, right in (
        ("natural head", natural),
        ("stored values", natural),
        ("second avatar", pixels(expected(session, session.state.values, camera, scene=1))),
    ):
        session.set_options(split=split, divider=0.25)
        image = shown(session).image  # exact although the mode is splats
        assert np.abs(image[:, :29].astype(int) - left[:, :29]).max() <= 1
        assert np.abs(image[:, 31:].astype(int) - right[:, 31:]).max() <= 1
        for divider, whole in ((0.0, right), (1.0, left)):
            session.set_options(divider=divider)
            assert np.abs(shown(session).image.astype(int) - whole).max() <= 1
    session.store()
    session.set_options(split="stored values", divider=0.0)
    assert np.abs(shown(session).image.astype(int) - left).max() <= 1


def test_playing_shows_one_timestep_after_the_other(two):
    session = Session(two, Page())
    session.set_view(VIEW)
    session.set_options(playing=True, speed=0.5)
    now, frames = 10.0, []
    for _ in range(7):
        now = session.step(now)
        frames.append(int(session.state.values["frame"]))
    assert frames == [1, 2, 0, 1, 2, 0, 1] and now == pytest.approx(10 + 7 / 12)
    session.step(now + 2.5 / 12)  # late by two timesteps: they are left out
    assert session.state.values["frame"] == (1 + 3) % 3
    assert session.page.frame in range(3)  # of the slider
    session.set_options(playing=False)
    assert not session.state.undo()


def test_undo_and_reset_move_the_sliders_of_the_page(two):
    session = Session(two, Page())
    session.set_view(VIEW)
    session.set_value("level", 0.2)
    session.undo()
    assert session.state.values["level"] == 0 and session.page.states == 1
    session.undo(again=True)
    assert session.state.values["level"] == 0.2
    session.reset()
    assert session.state.values["level"] == 0 and session.page.states == 3


def test_hostile_values_are_refused_and_change_nothing(two):
    session = Session(two, Page())
    session.set_view(VIEW._replace(fov=float("nan")))
    assert session.view is None
    session.set_view(VIEW)
    before = session.options
    for options in (
        {"mode": "x"},
        {"overlay": None},
        {"divider": "0.5"},
        {"speed": 1e9},
        {"camera": 3},
        {"divider": -1},
    ):
        with pytest.raises(SettingsError):
            session.set_options(**options)
    with pytest.raises(SettingsError, match="second"):
        Session(subject(), Page()).set_options(split="second avatar")
    for height in (1, 1e9, "tall", float("nan")):
        with pytest.raises(SettingsError, match="height"):
            session.export_camera(height)
    assert session.options == before
