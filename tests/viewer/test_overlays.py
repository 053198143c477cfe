"""What is laid over a head."""

import cv2
import numpy as np
import pytest
from avatars import CAMERA, ball_avatar

from carigs.head import subject_exaggerator
from carigs.library import HeadAvatar
from carigs.raster import compute_visibility
from carigs.settings import Exaggerate
from carigs.viewer.exact_mode import fitted
from carigs.viewer.overlays import GREY, LINE, curvature_colours, draw_mesh, error_image, fit_into, flag_colours


@pytest.fixture(scope="module")
def avatar():
    return HeadAvatar(ball_avatar())


def test_the_lines_lie_on_the_mesh(avatar):
    camera = CAMERA.scaled(4)
    vertices, faces = avatar.mesh()
    image = np.full((256, 256, 3), 200, np.uint8)
    draw_mesh(image, vertices, faces, camera)
    drawn = (image != 200).any(axis=2)
    on_mesh = compute_visibility(vertices, faces, camera).face >= 0
    assert 0.1 < drawn[on_mesh].mean() < 0.9
    near_mesh = cv2.dilate(on_mesh.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0  # lines have a width
    assert not (drawn & ~near_mesh).any()
    assert (image[drawn].astype(int) @ [-1, 2, -1]).mean() > 50 and LINE[1] > 200  # green


def test_colours_of_triangles(avatar):
    head = avatar.avatar.sequence.head
    curvature = curvature_colours(avatar)
    assert curvature.shape == (len(head.faces), 3) and 0 <= curvature.min() and curvature.max() <= 1
    equation = subject_exaggerator(head, head.v_template.astype(np.float64), Exaggerate())
    order = np.argsort(equation.face_mean(equation.log_curvature))
    assert curvature[order[0], 2] > curvature[order[0], 0] and curvature[order[-1], 0] > curvature[order[-1], 2]
    flags = flag_colours(avatar)
    scalp = head.face_region("scalp")
    assert (flags[scalp] != GREY).any(axis=1).all() and (flags[~scalp & (flags == GREY).all(axis=1)] == GREY).all()


def test_the_error_of_an_image():
    image = np.full((5, 4, 3), 0.5, np.float32)
    colours, psnr = error_image(image, image + np.float32(0.1))
    assert psnr == pytest.approx(20, abs=1e-4)
    assert (colours == colours[0, 0]).all() and colours.max() > 0.3
    colours, psnr = error_image(image, image)
    assert psnr == np.inf and colours.max() < 0.02


@pytest.mark.parametrize(("width", "height"), [(200, 100), (50, 120), (30, 30)])
def test_a_captured_image_lies_where_its_camera_lies(width, height):
    columns, rows = np.meshgrid(np.arange(64) + 0.5, np.arange(64) + 0.5)
    ramp = np.stack([columns, rows, 0 * rows], axis=2) / 64
    fit = fit_into(ramp, width, height, 1.0)
    camera = fitted(CAMERA, width, height)
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    expected = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy], axis=2) * 150 / 64 + 0.5
    inside = ((expected > 0.06) & (expected < 0.94)).all(axis=2)
    np.testing.assert_allclose(fit[inside][:, :2], expected[inside], atol=2e-3)
    outside = ((expected < -0.06) | (expected > 1.06)).any(axis=2)
    assert (fit[outside] == 1).all()
