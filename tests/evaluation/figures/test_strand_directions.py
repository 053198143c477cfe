"""Lines along the strands of the hair, on the capture of a ball."""

import numpy as np
import pytest

from carigs.capture import Capture
from carigs.compile_ahead.ball_capture import RADIUS, write_ball_capture
from carigs.hair import FoundHair
from carigs.hair.hull import Voxels
from carigs.hair.strands import Strands
from carigs.hair.views import read_views, scalp_motion
from carigs.head import neutral
from evaluation.figures.strand_directions import FADED, LENGTH, SCALE, image_segments, strand_images


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    return Capture.load(write_ball_capture(tmp_path_factory.mktemp("ball") / "capture"))


def hair_of(centres, directions, opacity, confidence):
    none, n = np.zeros(0, bool), len(centres)
    strands = Strands(np.array(directions, np.float32), np.array(confidence, np.float32), np.zeros((n, 3), np.float32))
    volume = Voxels(np.array(centres, np.float32), np.array(opacity, np.float32), 0.004)
    return FoundHair(np.zeros(0, np.float32), none, none, none, volume, np.ones(n, np.float32), strands)


def test_lines_are_the_images_of_the_strands_that_a_camera_shows(capture):
    top, behind = RADIUS + 0.02, -RADIUS - 0.02
    centres = [(-0.05, top, 0), (0.05, top, 0), (0.051, top, 0), (0, top, 0), (0, 0, behind)]
    directions = [(1, 0, 0), (0, 1, 0), (1, 0, 0), (1, 0, 0), (1, 0, 0)]
    # The third lies in the same square as the second, the fourth is thin, and the ball hides the last.
    found = hair_of(centres, directions, [1, 1, 1, 0.2, 1], [0.9, 0.8, 0.3, 1, 1])
    canonical = neutral(capture.model, capture.parameters(capture.split("train")[0].timestep))
    carrier = np.unique(capture.model.faces[capture.model.face_region("scalp")])
    for view in read_views(capture):
        camera = view.visibility.camera
        segments, confidence = image_segments(found, view, scalp_motion(canonical, view.visibility, carrier))
        order = np.argsort(-confidence)
        np.testing.assert_allclose(confidence[order], [0.9, 0.8])
        for segment, i in zip(segments[order], (0, 1), strict=True):
            ends = np.array(centres[i]) + 0.5 * LENGTH * np.array([[-1], [1]]) * directions[i]
            np.testing.assert_allclose(segment, camera.project(ends)[0], atol=1e-3)


def test_lines_lie_on_the_faded_frame(capture):
    centres = [(x, RADIUS + 0.01, z) for x in np.linspace(-0.04, 0.04, 9) for z in (-0.02, 0.0, 0.02)]
    found = hair_of(centres, [(1, 0, 0)] * len(centres), np.ones(len(centres)), np.full(len(centres), 0.9))
    frame, drawn = strand_images(capture, found)
    assert frame.shape == drawn.shape == (48 * SCALE, 48 * SCALE, 3)
    faded = FADED + (1 - FADED) * frame
    changed = np.abs(drawn - faded).max(axis=2) > 0.05
    np.testing.assert_allclose(drawn[~changed], faded[~changed], atol=0.05)
    rows = np.nonzero(changed)[0]
    assert 0 < len(rows) and rows.max() < 0.6 * len(frame)  # the scalp is the upper part of the ball
