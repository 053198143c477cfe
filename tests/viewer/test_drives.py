"""Motions in the viewer: what a session shows is the avatar driven by the motion."""

import numpy as np
import pytest
from avatars import ball_avatar
from viewer.test_session import VIEW, Page, expected, shown

from carigs.errors import SettingsError
from carigs.library import HeadAvatar
from carigs.motion import BUILT_IN
from carigs.viewer import drives
from carigs.viewer.drives import CAPTURED
from carigs.viewer.session import Session
from carigs.viewer.splat_records import splat_records
from carigs.viewer.state import MOTION
from carigs.viewer.subject import Subject


@pytest.fixture(scope="module")
def avatar():
    return HeadAvatar(ball_avatar(sh_degree=0))


@pytest.fixture(scope="module")
def subject(avatar):
    return Subject(avatar, motions={"take": avatar.captured_motion(10.0)})


def test_the_motions_are_the_given_and_the_built_in_ones(subject):
    assert [drive.name for drive in subject.scenes[0].drives] == ["take", "idle", "talk"]


def test_a_frame_of_a_motion_is_the_driven_avatar(avatar, subject):
    session = Session(subject, Page())
    session.set_view(VIEW)
    session.set_options(motion="take")
    session.set_value("level", 0.2)
    session.state.drive(1, 2)
    page = shown(session)
    (*_, last) = avatar.animate(avatar.captured_motion(10.0), 0.2)
    np.testing.assert_allclose(subject.scenes[0].vertices(session.state.values), last.vertices, atol=1e-6)
    world = subject.scenes[0].surfels(session.state.values, VIEW.camera().centre)
    np.testing.assert_array_equal(page.splats, splat_records(world))
    assert expected(session, session.state.values, VIEW.camera()).shape == (80, 120, 3)


def test_playing_keeps_the_time_of_the_motion_and_drops_frames_when_it_is_late(subject):
    session = Session(subject, Page())
    session.set_view(VIEW)
    session.set_options(motion="take", playing=True)
    now, frames = 5.0, []
    for wait in (0.0, 0.1, 0.1, 0.25, 0.1):
        now += wait
        session.step(now)
        frames.append(int(session.state.values[MOTION[1]]))
    assert frames == [1, 2, 0, 2, 0]  # three frames, 10 a second
    due = session.step(now)
    assert 0 < due - now < 0.11


def test_the_capture_comes_back_and_undo_knows_nothing_of_motions(subject):
    session = Session(subject, Page())
    session.set_options(motion="talk")
    assert session.state.values[MOTION[0]] == 3
    session.set_options(motion=CAPTURED)
    assert not any(name in session.state.values for name in MOTION)
    assert not session.state.undo()
    with pytest.raises(SettingsError, match="motion: one of as captured, take, idle, talk"):
        session.set_options(motion="dance")


def test_a_head_that_cannot_do_the_built_in_motions_has_the_given_ones_alone(avatar, monkeypatch):
    def refuse(sequence, motion, driver=None):
        if "eyeBlinkLeft" in motion.names:
            raise SettingsError("motion: it cannot")
        return [sequence.parameters[0]] * len(motion)

    monkeypatch.setattr(drives, "driven_parameters", refuse)
    motion = avatar.captured_motion(10.0)
    assert [drive.name for drive in drives.drives_of(avatar, {"take": motion})] == ["take"]
    with pytest.raises(SettingsError, match="it cannot"):
        drives.drives_of(avatar, {"idle": BUILT_IN["idle"]()})
