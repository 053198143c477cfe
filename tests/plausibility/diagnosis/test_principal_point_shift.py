"""The shift of the principal point that was planted into cameras is measured to a fraction of a pixel."""

from dataclasses import replace

import numpy as np
import pytest
from miniature import bust_cameras, bust_model

from carigs.capture import Camera
from carigs.capture.frame import Frame
from carigs.mesh.triangle_mesh import vertex_normals
from carigs.plausibility.diagnosis.principal_point_shift import shift_of_outlines
from carigs.plausibility.diagnosis.scene import Head, Scene, Shot
from carigs.raster import compute_visibility

ENLARGED = 8
"""The mattes are known at so many times the resolution of the cameras, as after an interpolation of soft edges."""


def frame(camera: int) -> Frame:
    return Frame(0, camera, "", "train", "image.png", "matte.png", "head.npz", camera)


def enlarged(camera: Camera) -> Camera:
    lengths = (ENLARGED * length for length in camera.intrinsics)
    return Camera(camera.camera_from_world, *lengths, ENLARGED * camera.width, ENLARGED * camera.height)


def scene(shift: tuple[float, float]) -> Scene:
    """Views of the bust, whose principal points are then stated too large by a shift."""
    model = bust_model()
    vertices = model.v_template.astype(np.float64)
    shots = []
    for c, camera in bust_cameras().items():
        matte = compute_visibility(vertices, model.faces, enlarged(camera)).face >= 0
        stated = replace(camera, cx=camera.cx + shift[0], cy=camera.cy + shift[1])
        shots.append(Shot(frame(c), stated, 0, np.zeros((*matte.shape, 3), np.uint8), matte))
    head = Head(vertices, vertex_normals(vertices, model.faces), np.zeros(3))
    return Scene(model, tuple(shots), {0: head})


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.5, 0.5), (-0.5, -0.5), (0.5, 0.0), (0.25, -0.75)])
def test_a_planted_shift_is_measured(shift):
    measured = shift_of_outlines(scene(shift))
    np.testing.assert_allclose(measured.shift, -np.array(shift), atol=0.05)
    assert measured.half_pixel == (-shift[0] if abs(shift[0]) == 0.5 and shift[0] == shift[1] else 0)


def test_outlines_without_a_matte_tell_nothing():
    without = scene((0.5, 0.5)).with_shots(lambda shot: replace(shot, matte=None))
    measured = shift_of_outlines(without)
    assert np.isinf(measured.error).all()
    assert measured.half_pixel == 0
