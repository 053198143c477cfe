"""Frames that are off their mesh are found by how far they are off."""

import numpy as np
import pytest
from miniature import ball_cameras, ball_model

from carigs.gtstar.registration import registration_errors, sample
from carigs.raster import rasterize_mesh


def painted(vertices, faces, camera):
    """The ball with a smooth pattern all over its surface, on grey."""
    hit = rasterize_mesh(vertices, faces, camera)
    points = np.einsum("hwc,hwcx->hwx", hit.barycentric, vertices[faces[hit.face]])
    pattern = 0.5 + 0.3 * np.sin(60 * points + np.array([0, 1, 2]))
    return np.where((hit.face >= 0)[..., None], pattern, 0.5).astype(np.float32)


@pytest.mark.parametrize(("dx", "dy"), [(0.0, 0.0), (0.6, 0.0), (0.0, -0.8), (0.5, 0.5)])
def test_a_shifted_image_is_off_by_its_shift(dx, dy):
    vertices, faces = ball_model().v_template.astype(np.float64), ball_model().faces
    cameras = {c: camera.scaled(4) for c, camera in ball_cameras().items()}
    views = {c: (painted(vertices, faces, camera), camera) for c, camera in cameras.items()}
    image, camera = views[1]
    y, x = np.mgrid[: camera.height, : camera.width] + 0.5
    x, y = np.clip(x - dx, 0.5, camera.width - 1.51), np.clip(y - dy, 0.5, camera.height - 1.51)
    shifted, _ = sample(image, np.column_stack([x.ravel(), y.ravel()]))
    views[1] = shifted.reshape(image.shape).astype(np.float32), camera
    found = registration_errors(views, vertices, faces)
    assert set(found) == {0, 1, 2}
    assert found[1].pixels == pytest.approx(np.hypot(dx, dy), abs=0.12)


def test_an_image_alone_has_nothing_to_be_compared_with():
    vertices, faces = ball_model().v_template.astype(np.float64), ball_model().faces
    camera = ball_cameras()[1]
    assert registration_errors({1: (painted(vertices, faces, camera), camera)}, vertices, faces) == {}
