"""A capture beside the avatar: its cameras, its images, and the truth."""

import re

import numpy as np
import pytest
from avatars import CAMERA, TIMESTEPS, ball_avatar

from carigs.capture import Camera, Capture, Frame, look_at
from carigs.capture.frame_index import ground_truth_files, write_ground_truth
from carigs.capture.images import write_png
from carigs.errors import SettingsError
from carigs.library import HeadAvatar
from carigs.viewer.exact_mode import View, page_pose
from carigs.viewer.overlays import fit_into
from carigs.viewer.session import Session
from carigs.viewer.state import State
from carigs.viewer.subject import Subject

CAMERAS = (CAMERA, Camera(look_at(np.array([-0.2, 0.0, 0.6]), np.zeros(3)), 140, 140, 30, 34, 64, 64))
LEVEL = 0.2


class Page:
    """Keeps what it is shown last."""

    def __init__(self):
        self.shown = {}

    def __getattr__(self, name):
        return lambda *arguments, **options: self.shown.__setitem__(name, arguments[0] if arguments else None)


@pytest.fixture(scope="module")
def subject(tmp_path_factory):
    """The avatar's own images as those of its capture, and those at a level as the truth."""
    folder, avatar = tmp_path_factory.mktemp("capture"), HeadAvatar(ball_avatar())
    frames = []
    for timestep in range(TIMESTEPS):
        for camera, view in enumerate(CAMERAS):
            name = f"{timestep}_{camera}.png"
            write_png(folder / name, avatar.render(view, timestep=timestep))
            frames.append(Frame(timestep, camera, "A", "train", name, None, "none.npz", camera))
    names = ground_truth_files(1, 0)
    write_png(folder / names["image"], avatar.render(CAMERAS[0], timestep=1, level=LEVEL))
    write_png(folder / names["mask"], np.ones((64, 64)))
    write_ground_truth(folder / "truth.json", LEVEL, [(1, 0)])
    capture = Capture(folder, folder / "head.npz", tuple(frames), CAMERAS, 1.0)
    return Subject(avatar, None, capture, folder / "truth.json")


def values_of(subject, **changes):
    state = State(subject.controls)
    for name, value in changes.items():
        state.set(name.replace("__", ":"), value, 0.0)
    return state.values


def session_at(subject, camera):
    """A session that looks through a camera of the capture."""
    session = Session(subject, Page())
    wxyz, position, fov = page_pose(subject.cameras[camera])
    session.set_view(View(wxyz, position, fov, 160, 80))
    session.set_options(mode="exact", camera=camera)
    return session


def shown(session, now=10.0):
    while (now := session.step(now)) is not None:
        pass
    return session.page.shown


def test_the_truth_is_the_capture_for_the_natural_head_and_its_images_at_their_level(subject):
    natural = subject.truth(1, values_of(subject, frame=2))
    np.testing.assert_allclose(natural, subject.avatar.render(CAMERAS[1], timestep=2), atol=0.6 / 255)
    there = subject.truth(0, values_of(subject, frame=1, level=LEVEL))
    np.testing.assert_allclose(there, subject.avatar.render(CAMERAS[0], timestep=1, level=LEVEL), atol=0.6 / 255)
    for camera, changes in (
        (0, {"frame": 1, "level": 0.1}), (1, {"frame": 1, "level": LEVEL}), (0, {"jaw__x": 5}),
        (0, {"region__scalp": 0.1}), (0, {"expression__0": 0.5}),
    ):  # fmt: skip
        assert subject.truth(camera, values_of(subject, **changes)) is None


def test_the_error_of_a_perfect_avatar_is_the_rounding_of_its_images(subject):
    session = session_at(subject, 1)
    session.set_view(session.view._replace(width=64, height=64))  # the camera's own pixels
    session.set_options(overlay="error")
    page = shown(session)
    assert float(re.search(r"PSNR ([\d.]+) dB", page["show_status"])[1]) > 50
    assert page["show_image"].mean() < 10
    session.set_value("level", 0.1)
    assert "no truth" in shown(session)["show_status"]
    session.set_value("level", LEVEL)
    assert "no truth" in shown(session)["show_status"]  # this camera has none at that level
    session.set_options(camera=0)
    session.set_value("frame", 1)
    assert float(re.search(r"PSNR ([\d.]+) dB", shown(session)["show_status"])[1]) > 50


def test_the_captured_image_lies_right_of_the_divider_and_beside_the_view(subject):
    session = session_at(subject, 0)
    session.set_options(split="captured image", divider=0.0)
    page = shown(session)
    captured = subject.captured(0, session.state.values)
    expected = np.rint(255 * fit_into(captured, 160, 80, 1.0))
    np.testing.assert_array_equal(page["show_image"], expected)
    np.testing.assert_array_equal(page["show_captured"], captured)
    session.set_options(divider=1.0)
    ours = shown(session)["show_image"].astype(int)
    assert np.abs(ours - expected).mean() < 3  # the avatar is perfect; only sampling differs


def test_turning_the_view_leaves_the_camera(subject):
    session = session_at(subject, 0)
    wxyz, position, _ = page_pose(subject.cameras[0])
    start = session.view._replace(position=(0.0, 0.0, 20.0))
    session.set_options(camera=0)
    session.set_view(start)  # the browser has not arrived there yet
    assert session.options.camera == 0
    session.set_view(start._replace(wxyz=wxyz, position=position))
    assert session.options.camera == 0
    session.set_view(start)
    assert session.options.camera is None and "show_state" in session.page.shown
    with pytest.raises(SettingsError, match="camera"):
        session.set_options(camera=7)


def test_without_a_capture_there_are_no_cameras_and_no_truth():
    subject = Subject(HeadAvatar(ball_avatar()))
    assert subject.cameras == {} and subject.captured(0, values_of(subject)) is None
    assert subject.truth(0, values_of(subject)) is None and subject.camera_at(0, values_of(subject)) is None
