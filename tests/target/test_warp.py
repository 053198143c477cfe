"""GT*: the warp against closed forms, the masks against what they promise."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from miniature import ball_cameras, ball_model

from carigs.capture import Camera, look_at
from carigs.raster import rasterize_mesh
from carigs.settings import Gtstar
from carigs.target import frozen_faces, validity, warp_frame

FRONTAL = Camera(look_at(np.array([0.0, 0.0, 1.0]), np.zeros(3)), 100, 100, 32, 24, 64, 48)


def sheet(n: int = 12, width: float = 0.4, height: float = 0.3) -> tuple[np.ndarray, np.ndarray]:
    """A flat grid of triangles in z = 0 that faces +z."""
    x, y = np.meshgrid(np.linspace(-width / 2, width / 2, n), np.linspace(-height / 2, height / 2, n))
    vertices = np.column_stack([x.ravel(), y.ravel(), np.zeros(n * n)])
    i = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.vstack([np.column_stack([i, i + 1, i + n + 1]), np.column_stack([i, i + n + 1, i + n])])
    return vertices, faces.astype(np.int32)


def picture(camera: Camera) -> np.ndarray:
    """An image that bilinear sampling reproduces exactly: colours affine in the pixel position."""
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    return np.stack([x / 100, y / 100, 0.3 + 0.002 * x - 0.003 * y], axis=-1).astype(np.float32)


@settings(max_examples=20, deadline=None)
@given(st.floats(0.7, 1.3), st.floats(0.7, 1.3), st.floats(-0.3, 0.3), st.floats(-0.05, 0.05), st.floats(-0.05, 0.05))
def test_an_affine_motion_in_the_image_plane_is_undone_exactly(sx, sy, shear, dx, dy):
    vertices, faces = sheet()
    linear, shift = np.array([[sx, shear], [0, sy]]), np.array([dx, dy])
    moved = vertices.copy()
    moved[:, :2] = vertices[:, :2] @ linear.T + shift
    image = picture(FRONTAL)
    warp = warp_frame(image, vertices, moved, faces, FRONTAL)
    on_mesh = warp.caricature.face >= 0
    y, x = np.nonzero(on_mesh)
    world = np.column_stack([(x + 0.5 - 32) / 100, -(y + 0.5 - 24) / 100])  # depth is 1 m
    source = (world - shift) @ np.linalg.inv(linear).T
    expected = np.column_stack([source[:, 0] * 100 + 32, -source[:, 1] * 100 + 24])
    np.testing.assert_allclose(warp.source_pixel[on_mesh], expected, atol=2e-4)
    inside = (np.abs(expected - [32, 24]) < [31, 23]).all(axis=1)
    colour = np.column_stack([expected / 100, 0.3 + expected @ [0.002, -0.003]])
    # cv2.remap holds fractions of a pixel to 1/32.
    np.testing.assert_allclose(warp.colour[on_mesh][inside], colour[inside], atol=0.02 / 32 + 1e-4)


def test_level_zero_is_the_frame_and_is_valid_inside_the_mesh():
    model, camera = ball_model(), ball_cameras()[1]
    vertices = model.v_template.astype(np.float64)
    image = np.random.default_rng(0).random((camera.height, camera.width, 3)).astype(np.float32)
    warp = warp_frame(image, vertices, vertices, model.faces, camera)
    on_mesh = warp.caricature.face >= 0
    np.testing.assert_allclose(warp.colour[on_mesh], image[on_mesh], atol=1e-6)
    np.testing.assert_array_equal(warp.colour[~on_mesh], 1.0)
    foreground = (warp.natural.face >= 0).astype(np.float32)
    judged = validity(warp, foreground, model, Gtstar(hair=False, regions=()))
    assert judged.valid[warp.caricature.face >= 0].all()
    assert not judged.invisible.any()


def test_each_triangle_keeps_its_corners():
    """Target corners map to source corners: the defining property of the affine map of a triangle."""
    model, camera = ball_model(subdivisions=1), ball_cameras()[1].scaled(8)
    vertices = model.v_template.astype(np.float64)
    moved = vertices * [1.3, 1.1, 0.9]
    warp = warp_frame(np.zeros((camera.height, camera.width, 3), np.float32), vertices, moved, model.faces, camera)
    y, x = np.nonzero(warp.caricature.face >= 0)
    pixels = np.column_stack([x, y]) + 0.5
    for f in np.unique(warp.caricature.face[y, x]):
        at = warp.caricature.face[y, x] == f
        if at.sum() < 12:
            continue
        design = np.column_stack([pixels[at], np.ones(at.sum())])
        affine, *_ = np.linalg.lstsq(design, warp.source_pixel[y[at], x[at]], rcond=None)
        corners = np.column_stack([warp.caricature_pixel[model.faces[f]], np.ones(3)])
        np.testing.assert_allclose(corners @ affine, warp.natural_pixel[model.faces[f]], atol=0.05)


def test_newly_visible_skin_is_masked():
    """A flap hides part of the sheet in the frame and is gone in the caricature: exactly that part is invisible."""
    vertices, faces = sheet()
    flap, flap_faces = sheet(4, 0.1, 0.1)
    both = np.vstack([vertices, flap + np.array([0, 0, 0.1])])
    moved = np.vstack([vertices, flap + np.array([5.0, 0, 0.1])])
    all_faces = np.vstack([faces, flap_faces + len(vertices)])
    model = ball_model()
    warp = warp_frame(picture(FRONTAL), both, moved, all_faces, FRONTAL)
    hidden = (warp.natural.face >= len(faces)) & (warp.caricature.face >= 0)
    judged = validity(warp, np.ones((48, 64), np.float32), model, Gtstar(hair=False, regions=()))
    assert hidden.sum() > 80
    assert np.array_equal(judged.invisible, hidden)


def test_background_is_where_nothing_is_and_where_skin_has_moved_away():
    """The shrunken ball leaves skin behind: background from the ring around the caricature on."""
    model, camera = replace(ball_model(), regions={}), ball_cameras()[1]
    vertices = model.v_template.astype(np.float64)
    warp = warp_frame(picture(camera), vertices, 0.8 * vertices, model.faces, camera)
    foreground = (warp.natural.face >= 0).astype(np.float32)
    judged = validity(warp, foreground, model, Gtstar(background_ring=1))
    on_mesh = warp.caricature.face >= 0
    assert ((foreground > 0) & ~on_mesh).sum() > 50
    assert np.array_equal(judged.outside, ~on_mesh & dilated(on_mesh))
    assert judged.valid[0, 0]


def test_hair_may_be_anywhere_within_its_length():
    """A tuft stands off the ball: no background near it or the scalp, and none where it stood but plain background."""
    model, camera = ball_model(), ball_cameras()[1]
    vertices = model.v_template.astype(np.float64)
    warp = warp_frame(picture(camera), vertices, 0.8 * vertices, model.faces, camera)
    foreground = (warp.natural.face >= 0).astype(np.float32)
    row, column = np.argwhere(foreground > 0)[0]
    assert row > 6, "room for the tuft above the ball"
    tuft = np.zeros_like(foreground, bool)
    tuft[row - 6 : row, column - 1 : column + 2] = True
    judged = validity(warp, np.maximum(foreground, tuft), model, Gtstar(background_ring=1))
    assert judged.outside[tuft].all()
    bald = validity(warp, foreground, model, Gtstar(background_ring=1))
    assert (judged.outside | ~bald.outside).all() and judged.outside.sum() > bald.outside.sum() + tuft.sum()
    assert not judged.outside[~dilated((foreground > 0) | tuft)].any()


def dilated(mask: np.ndarray) -> np.ndarray:
    """The mask and its four neighbours in each pixel's direction."""
    grown, padded = mask.copy(), np.pad(mask, 1)
    for dy, dx in ((0, 1), (2, 1), (1, 0), (1, 2)):
        grown |= padded[dy : dy + mask.shape[0], dx : dx + mask.shape[1]]
    return grown


@pytest.mark.parametrize("hair", [True, False])
def test_hair_pixels_and_frozen_faces_agree(hair):
    model, camera = ball_model(), ball_cameras()[2]
    vertices = model.v_template.astype(np.float64)
    chosen = Gtstar(hair=hair, regions=())
    warp = warp_frame(picture(camera), vertices, vertices * [1.2, 1, 1], model.faces, camera)
    judged = validity(warp, (warp.natural.face >= 0).astype(np.float32), model, chosen)
    frozen = frozen_faces(model, chosen)
    assert frozen.any() == hair
    on_frozen = (warp.caricature.face >= 0) & frozen[warp.caricature.face]
    assert not (judged.valid & on_frozen).any()


def test_source_depth_is_the_depth_of_the_natural_surface():
    model, camera = ball_model(), ball_cameras()[0]
    vertices = model.v_template.astype(np.float64)
    warp = warp_frame(picture(camera), vertices, vertices, model.faces, camera)
    natural = rasterize_mesh(vertices, model.faces, camera)
    hit = natural.face >= 0
    np.testing.assert_allclose(warp.source_depth[hit], natural.depth[hit], rtol=1e-5)
