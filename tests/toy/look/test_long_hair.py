"""Long hair: outside of the head, over forehead and ears but not over the eyes, and solid where it moves."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from carigs.head import HeadParameters, neutral
from carigs.raster import rasterize_mesh
from carigs.settings import Toy
from carigs.toy import make_subject
from carigs.toy.look.hair_rendering import ribbon_faces, strand_ribbons
from carigs.toy.look.lighting import StudioLight
from carigs.toy.look.strands import height_and_normal, smooth_frames, triangle_frames, with_knots
from carigs.toy.scene import studio_cameras
from carigs.toy.shape.head_solids import head_solids

SETTINGS = Toy(cameras=9, texture_size=128, hair="long", hair_strands=4000)


@pytest.fixture(scope="module")
def subject():
    return make_subject(SETTINGS)


@pytest.fixture(scope="module")
def scalp_strands(subject):
    """Indices of the strands of the scalp, which come first: brows and lashes are short."""
    length = np.linalg.norm(np.diff(subject.strands.local, axis=1), axis=2).sum(axis=1)
    return np.flatnonzero(length > 10)


def points_of(subject):
    """Points of the strands on the template, in millimetres."""
    strands, vertices = subject.strands, 1000 * subject.model.v_template
    corners = vertices[subject.model.faces[strands.face]]
    roots = np.einsum("si,sij->sj", strands.barycentric, corners)
    axes = triangle_frames(vertices, subject.model.faces)[strands.face]
    return roots[:, None] + np.einsum("sij,ski->skj", axes, strands.local)


def test_strands_lie_outside_of_the_head(subject, scalp_strands):
    points = points_of(subject)[scalp_strands]
    height, _ = height_and_normal(head_solids(), points.reshape(-1, 3))
    assert np.mean(height < -0.5) < 0.01 and height.min() > -6
    assert np.quantile(height.reshape(points.shape[:2])[:, -1], 0.9) < 60  # they hang down and do not stand off


def test_the_fringe_ends_above_the_eyes_and_the_other_hair_at_the_neck(subject, scalp_strands):
    points = points_of(subject)[scalp_strands]
    azimuth = np.degrees(np.abs(np.arctan2(points[:, 0, 0], points[:, 0, 2] + 25)))
    tips = points[:, -1, 1]
    assert 30 < np.median(tips[azimuth < 30]) < 50
    assert -95 < np.median(tips[azimuth > 60]) < -60


def test_hair_hides_the_ears_and_most_of_the_forehead_but_not_the_eyes(subject):
    rest = neutral(subject.model, HeadParameters(shape=subject.shape))
    faces, strands = subject.model.faces, subject.strands
    roots = np.einsum("si,sij->sj", strands.barycentric, rest[faces[strands.face]])
    hair_faces = ribbon_faces(len(roots), strands.local.shape[1], len(rest))
    seen, bare = np.zeros(len(faces)), np.zeros(len(faces))
    for camera in studio_cameras(SETTINGS):
        hair = (strands, strands.colour, roots, subject.strand_frames(rest), 1e-3, camera.centre, StudioLight())
        ribbons, _ = strand_ribbons(*hair)
        both = rasterize_mesh(np.concatenate([rest, ribbons]), np.concatenate([faces, hair_faces]), camera).face
        alone = rasterize_mesh(rest, faces, camera).face
        seen += np.bincount(both[(both >= 0) & (both < len(faces))], minlength=len(faces))
        bare += np.bincount(alone[alone >= 0], minlength=len(faces))

    def share(inside):
        return seen[inside].sum() / bare[inside].sum()

    region, middle = subject.model.face_region, subject.model.v_template[faces].mean(axis=1)
    ears = region("left_ear", "right_ear")
    forehead = (middle[:, 1] > 0.065) & (middle[:, 1] < 0.095) & (middle[:, 2] > 0.07)
    assert share(ears) < 0.1
    assert share(forehead) < 0.4
    assert share(region("left_eyeball", "right_eyeball")) > 0.6
    assert share(region("nose")) > 0.9


def test_smooth_frames_follow_a_rigid_motion_and_average_any_other(subject):
    template, faces, roots = subject.model.v_template.astype(float), subject.model.faces, subject.strands.face
    turn = Rotation.from_rotvec([0.3, -0.8, 0.4]).as_matrix()
    frames = smooth_frames(template, template @ turn.T + 0.1, faces, roots, 0.03)
    np.testing.assert_allclose(frames, triangle_frames(template, faces)[roots] @ turn.T, atol=1e-9)
    rough = template + np.random.default_rng(0).normal(0, 2e-4, template.shape)
    smooth, own = smooth_frames(template, rough, faces, roots, 0.03), triangle_frames(rough, faces)[roots]
    still = triangle_frames(template, faces)[roots]
    np.testing.assert_allclose(smooth @ smooth.transpose(0, 2, 1), np.tile(np.eye(3), (len(roots), 1, 1)), atol=1e-9)
    assert np.abs(smooth - still).mean() < 0.1 * np.abs(own - still).mean()


def test_more_knots_lie_on_the_same_strand(subject):
    strands = subject.strands
    assert with_knots(strands, strands.local.shape[1]) is strands
    finer = with_knots(strands, 2 * strands.local.shape[1] - 1)  # every second knot is one of before
    np.testing.assert_allclose(finer.local[:, ::2], strands.local, atol=1e-4)
    np.testing.assert_allclose(finer.local[:, 1::2], 0.5 * (strands.local[:, 1:] + strands.local[:, :-1]), atol=1e-4)
    np.testing.assert_allclose(finer.shade[:, ::2], strands.shade, atol=1e-5)
