"""Angles, openings, sharpness, coverage and the table of errors, against what is known."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tracking.recordings import COUNT, recording

from carigs.capture import look_at
from carigs.detection import mesh_indices as mesh
from carigs.tracking.judgement.coverage import coverage
from carigs.tracking.judgement.error_table import error_table
from carigs.tracking.judgement.quality import face_sharpness, head_angles, openings


@pytest.mark.parametrize(("yaw", "pitch", "roll"), [(0, 0, 0), (30, 0, 0), (-20, 15, 0), (10, -25, 12)])
def test_head_angles_are_those_that_the_head_was_turned_by(yaw, pitch, roll):
    world_from_head = Rotation.from_euler("YXZ", [yaw, pitch, roll], degrees=True).as_matrix()
    front = look_at(np.array([0.0, 0, 1]), np.zeros(3))[:3, :3]
    ahead = np.array([[0.0, 0, 2]])
    found = head_angles((front @ world_from_head)[None], ahead)
    np.testing.assert_allclose(np.ravel(found), [yaw, pitch], atol=1e-9)
    # A camera to the person's left sees the head turned to the right.
    aside = look_at(np.array([np.sin(0.3), 0, np.cos(0.3)]), np.zeros(3))[:3, :3]
    assert head_angles((aside @ np.eye(3))[None], ahead)[0] == pytest.approx(-np.degrees(0.3))


def test_a_head_at_the_side_of_the_image_that_looks_at_the_camera_is_not_turned():
    front = look_at(np.array([0.0, 0, 1]), np.zeros(3))[:3, :3]
    for place in (
        [0.4, 0.1, -1.0],
        [-0.2, -0.3, -0.5],
    ):  # in the axes of the world
        z = -np.array(place) / np.linalg.norm(place)
        x = np.cross([0.0, 1, 0], z) / np.linalg.norm(np.cross([0.0, 1, 0], z))
        looks_at_the_camera = np.stack([x, np.cross(z, x), z], axis=1)
        found = head_angles((front @ looks_at_the_camera)[None], (front @ place)[None])
        np.testing.assert_allclose(np.ravel(found), 0, atol=1e-9)


def test_openings_do_not_depend_on_size_and_turn():
    points = np.zeros((1, mesh.COUNT, 3))
    points[0, mesh.LEFT_EYE[0]], points[0, mesh.LEFT_EYE[8]] = (-50, 0, 0), (-20, 0, 0)
    points[0, mesh.RIGHT_EYE[0]], points[0, mesh.RIGHT_EYE[8]] = (50, 0, 0), (20, 0, 0)
    for pairs, height in ((mesh.LIP_GAPS, 25), (mesh.LEFT_LID_GAPS, 3), (mesh.RIGHT_LID_GAPS, 9)):
        for upper, lower in pairs:
            points[0, upper], points[0, lower] = (0, 60, 0), (0, 60 + height, 0)
    turned = 3 * points @ Rotation.from_euler("y", 40, degrees=True).as_matrix().T
    for shown in (points, turned):
        mouth, eyes = openings(shown)
        assert mouth[0] == pytest.approx(0.25) and eyes[0] == pytest.approx(0.3)  # of the wider eye


def test_sharpness_falls_with_blur_and_hardly_with_size():
    pattern = cv2.resize(
        np.random.default_rng(0).uniform(0, 255, (64, 64, 3)), (512, 512), interpolation=cv2.INTER_CUBIC
    )
    image = pattern.clip(0, 255).astype(np.uint8)
    whole = (0, 0, 512, 512)
    sharp = face_sharpness(image, whole)
    blurred = [face_sharpness(cv2.GaussianBlur(image, (0, 0), sigma), whole) for sigma in (4, 8)]
    assert sharp > 1.5 * blurred[0] > 3 * blurred[1]
    half = cv2.resize(image, (256, 256), interpolation=cv2.INTER_AREA)
    assert face_sharpness(half, (0, 0, 256, 256)) == pytest.approx(sharp, rel=0.05)
    assert face_sharpness(image, (600, 0, 700, 100)) == 0


def test_coverage_of_a_sweep_to_one_side():
    seen = coverage(np.linspace(0, 30, 300), np.zeros(300))
    assert seen.left == 30 and seen.right == 0 and seen.up == 0
    assert seen.yaw_share == pytest.approx(0.5) and seen.pitch_share == pytest.approx(1 / 5)
    assert seen.counts.sum() == 300
    unseen = coverage(np.full(3, np.nan), np.zeros(3))
    assert unseen.yaw_share == 0 and unseen.left < 0


def test_the_error_table_has_medians_and_percentiles_of_known_frames():
    errors = np.arange(COUNT, dtype=float)
    errors[:100] = np.nan
    lines = error_table(recording(errors={"lips": errors, "nose": np.full(COUNT, np.nan)})).splitlines()
    assert [line.split()[0] for line in lines] == ["region", "lips", "nose", "all"]
    assert lines[1].split()[1:] == ["299.50", "px", "459.10", "px", "499"]
    assert lines[2].split()[1:] == ["-", "-", "-"]
    assert lines[3].split()[1:] == lines[1].split()[1:]  # what is unknown takes no part
    assert len({len(line) for line in lines}) == 1
