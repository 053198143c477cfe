"""Which kind of footage a recording is, by its background, its mouth, and the sizes of its images."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from carigs.detection import FaceTrack
from carigs.detection.likeness import COLOURS
from carigs.detection.mesh_indices import COUNT, LEFT_EYE, LIP_GAPS, RIGHT_EYE
from carigs.footage import Footage
from carigs.footage.measures import measure_frames
from carigs.tracking.kinds import background_sweep, why_orbit, why_photographs
from carigs.tracking.recording import Recording

T, WIDTH, HEIGHT = 20, 320, 240


def recording(step, mouth):
    """A room that moves by so many pixels a frame behind a grey person, and the openings of the mouth."""
    noise = np.random.default_rng(0).uniform(0, 255, (HEIGHT // 8, 120)).astype(np.float32)
    room = cv2.resize(noise, None, fx=8, fy=8, interpolation=cv2.INTER_CUBIC).clip(0, 255).astype(np.uint8)
    images = np.repeat(np.stack([room[:, 10 + round(t * step) :][:, :WIDTH] for t in range(T)])[..., None], 3, axis=3)
    images[:, 60:, 110:210] = 128
    landmarks = np.zeros((T, COUNT, 3), np.float32)
    landmarks[:, LEFT_EYE[0], 0], landmarks[:, RIGHT_EYE[0], 0] = -50, 50
    landmarks[:, [below for _, below in LIP_GAPS], 1] = 100 * np.asarray(mouth)[:, None]
    boxes = np.tile(np.float32([130, 70, 190, 150]), (T, 1))
    faces = FaceTrack(
        landmarks, np.ones(T, np.float32), boxes, np.ones(T, int), np.zeros(T, bool), np.zeros((T, COLOURS), np.float32)
    )
    numbers = tuple(range(T))
    footage = Footage(Path("me.mp4"), WIDTH, HEIGHT, numbers, np.arange(T) / 10, 10.0, 1.9, None, lambda: iter(images))
    return Recording(footage, faces, measure_frames(footage))


STILL, TALKING = np.full(T, 0.02), 0.1 * (1 + np.sin(np.arange(T)))


@pytest.mark.parametrize(("step", "sweep"), [(0, 0), (8, 8 * (T - 1) / WIDTH), (1, (T - 1) / WIDTH)])
def test_the_way_of_the_background_is_measured_beside_the_person(step, sweep):
    assert background_sweep(recording(step, STILL)) == pytest.approx(sweep, abs=0.02)


def test_a_camera_circles_if_the_background_moves_and_the_mouth_keeps_still():
    reason = why_orbit(recording(12, STILL))
    assert "0.7 of its widths" in reason and "mouth keeps still" in reason
    assert why_orbit(recording(12, TALKING)) == ""  # a selfie of somebody who walks and talks
    assert why_orbit(recording(0, STILL)) == ""


def test_views_of_an_orbit_are_recordings_of_one_frame():
    whole = recording(3, STILL)
    views = whole.views(7)
    assert len(views) == 7
    numbers = [view.footage.numbers[0] for view in views]
    assert numbers[0] == 0 and numbers[-1] == T - 1
    images = list(whole.footage.decode())
    for view, number in zip(views, numbers, strict=True):
        [image] = view.footage.decode()
        np.testing.assert_array_equal(image, images[number])
        assert len(view.faces.found) == len(view.measures.exposure) == len(view.footage) == 1


def test_images_of_several_sizes_or_layouts_are_photographs(tmp_path):
    images = list(recording(1, STILL).footage.decode())
    for number, image in enumerate(images[:6]):
        Image.fromarray(image).save(tmp_path / f"{number}.png")
    assert why_photographs(tmp_path) == ""  # frames of a video
    Image.fromarray(images[0][:100]).save(tmp_path / "9.png")
    assert why_photographs(tmp_path) == "the images have several sizes"


def test_images_that_differ_from_each_other_are_photographs(tmp_path):
    for number in range(4):
        blocks = np.random.default_rng(number).integers(0, 255, (6, 8, 3), dtype=np.uint8)
        Image.fromarray(blocks.repeat(20, axis=0).repeat(20, axis=1)).save(tmp_path / f"{number}.png")
    assert "differs from the one before" in why_photographs(tmp_path)
