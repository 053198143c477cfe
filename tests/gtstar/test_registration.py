"""Registration errors of shifted images."""

import numpy as np
import pytest
from miniature import ball_cameras, ball_model

from carigs.gtstar.registration import registration_errors
from carigs.raster import Visibility, compute_visibility
from carigs.raster.vertex_colours import sample_colours


def painted(visibility: Visibility, vertices: np.ndarray) -> np.ndarray:
    """The ball with a smooth pattern all over its surface, on grey."""
    hit, faces = visibility.fragments, visibility.faces
    points = np.einsum("hwc,hwcx->hwx", hit.barycentric, vertices[faces[hit.face]])
    pattern = 0.5 + 0.3 * np.sin(60 * points + np.array([0, 1, 2]))
    return np.where((hit.face >= 0)[..., None], pattern, 0.5).astype(np.float32)


@pytest.mark.parametrize(("dx", "dy"), [(0.0, 0.0), (0.6, 0.0), (0.0, -0.8), (0.5, 0.5)])
def test_the_error_of_a_shifted_image_is_its_shift(dx, dy):
    vertices, faces = ball_model().v_template.astype(np.float64), ball_model().faces
    cameras = {c: camera.scaled(4) for c, camera in ball_cameras().items()}
    seen = {c: compute_visibility(vertices, faces, camera) for c, camera in cameras.items()}
    views = {c: (painted(visibility, vertices), visibility) for c, visibility in seen.items()}
    image, camera = views[1][0], cameras[1]
    y, x = np.mgrid[: camera.height, : camera.width] + 0.5
    x, y = np.clip(x - dx, 0.5, camera.width - 1.51), np.clip(y - dy, 0.5, camera.height - 1.51)
    shifted, _ = sample_colours(image, np.column_stack([x.ravel(), y.ravel()]))
    views[1] = shifted.reshape(image.shape).astype(np.float32), seen[1]
    errors = registration_errors(views, vertices, faces)
    assert set(errors) == {0, 1, 2}
    assert errors[1].pixels == pytest.approx(np.hypot(dx, dy), abs=0.12)


def test_a_single_image_has_no_error():
    vertices, faces = ball_model().v_template.astype(np.float64), ball_model().faces
    seen = compute_visibility(vertices, faces, ball_cameras()[1])
    assert registration_errors({1: (painted(seen, vertices), seen)}, vertices, faces) == {}
