"""GT*: the warp against closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from miniature import FRONTAL, picture, sheet

from carigs.capture import Camera, look_at
from carigs.errors import SettingsError
from carigs.gtstar import MaskFlag, warp_frame
from carigs.gtstar.warp import source_maps
from carigs.raster import Visibility, compute_visibility
from carigs.settings import Gtstar


def source_pixels(natural: Visibility, caricature: Visibility, kind: str) -> np.ndarray:
    """Where in the frame each target pixel on the mesh comes from (n, 2)."""
    y, x = np.nonzero(caricature.face >= 0)
    maps = source_maps(natural, caricature, kind)[caricature.face[y, x]]
    source = np.einsum("nij,nj->ni", maps, np.column_stack([x + 0.5, y + 0.5, np.ones(len(x))]))
    return source[:, :2] / source[:, 2:]


def warped(image, natural, caricature, faces, camera, **changes):
    """The warp, and the visibility of both meshes."""
    gtstar = Gtstar(**{"supersampling": 1, **changes})
    ends = [compute_visibility(vertices, faces, camera) for vertices in (natural, caricature)]
    face_flags = np.zeros(len(faces), np.uint16)
    frame_flags = np.zeros((camera.height, camera.width), np.uint16)
    return warp_frame(image, *ends, face_flags, frame_flags, gtstar), *ends


@pytest.mark.parametrize("kind", ["affine", "perspective"])
@settings(max_examples=20, deadline=None)
@given(st.floats(0.7, 1.3), st.floats(0.7, 1.3), st.floats(-0.3, 0.3), st.floats(-0.05, 0.05), st.floats(-0.05, 0.05))
def test_an_affine_motion_in_the_image_plane_is_undone_exactly(kind, sx, sy, shear, dx, dy):
    vertices, faces = sheet()
    linear, shift = np.array([[sx, shear], [0, sy]]), np.array([dx, dy])
    moved = vertices.copy()
    moved[:, :2] = vertices[:, :2] @ linear.T + shift
    warp, natural, caricature = warped(picture(FRONTAL), vertices, moved, faces, FRONTAL, warp=kind)
    on_mesh = caricature.face >= 0
    y, x = np.nonzero(on_mesh)
    world = np.column_stack([(x + 0.5 - 32) / 100, -(y + 0.5 - 24) / 100])  # depth is 1 m
    source = (world - shift) @ np.linalg.inv(linear).T
    expected = np.column_stack([source[:, 0] * 100 + 32, -source[:, 1] * 100 + 24])
    np.testing.assert_allclose(source_pixels(natural, caricature, kind), expected, atol=1e-5)
    inside = (np.abs(expected - [32, 24]) < [30, 22]).all(axis=1) & (warp.mask_flags[on_mesh] == 0)
    # Within a pixel of the sheet's edge the neighbours off the sheet give their weight to the others.
    inside &= (np.abs(expected - [32, 24]) < [19, 14]).all(axis=1)
    colour = np.column_stack([expected / 100, 0.3 + expected @ [0.002, -0.003]])
    np.testing.assert_allclose(warp.colour[on_mesh][inside], colour[inside], atol=1e-5)


def surfaces():
    """A tilted plane that is stretched and turned, and half a cylinder that is bent open; known point by point."""
    u, v = (grid.ravel() for grid in np.meshgrid(np.linspace(-1, 1, 41), np.linspace(-1, 1, 41)))
    tilted = np.column_stack([0.12 * u, 0.09 * v, 0.08 * u - 0.05 * v])
    turned = np.column_stack([0.15 * u, 0.10 * v + 0.02 * u, 0.05 * v - 0.06 * u])
    cylinder = np.column_stack([0.1 * np.sin(1.2 * u), 0.1 * v, 0.1 * np.cos(1.2 * u)])
    opened = np.column_stack([0.13 * np.sin(0.9 * u), 0.11 * v, 0.09 * np.cos(0.9 * u)])
    return {"plane": (tilted, turned), "cylinder": (cylinder, opened)}


@pytest.mark.parametrize("surface", ["plane", "cylinder"])
def test_a_point_of_the_surface_is_found_where_it_is_in_the_frame(surface):
    """The 3D point of each pixel, carried along by its triangle, projected, to 0.001 pixels; affine is further off."""
    natural, caricature = surfaces()[surface]
    faces = sheet(41)[1]
    camera = Camera(look_at(np.array([0.1, 0.1, 0.8]), np.zeros(3)), 380, 380, 64, 48, 128, 96)
    errors = {}
    for kind in ("perspective", "affine"):
        ends = [compute_visibility(vertices, faces, camera) for vertices in (natural, caricature)]
        fragments = ends[1].fragments
        on_mesh = fragments.face >= 0
        weights, corners = fragments.barycentric[on_mesh], faces[fragments.face[on_mesh]]
        points = np.einsum("pk,pkc->pc", weights, natural[corners])
        expected, _ = camera.project(points)
        errors[kind] = float(np.abs(source_pixels(*ends, kind) - expected).max())
    assert on_mesh.sum() > 2000
    assert errors["perspective"] < 1e-3
    assert errors["affine"] < 0.1
    assert errors["perspective"] < errors["affine"]


def test_colours_are_never_fetched_from_the_background_or_across_an_edge():
    """A white sheet before a black one before a red background: every warped pixel is white or black."""
    vertices, faces = sheet()
    flap, flap_faces = sheet(4, 0.1, 0.1)
    both = np.vstack([vertices, flap + np.array([0.0123, 0.0057, 0.1])])
    moved = np.vstack([vertices * 1.1, flap + np.array([-0.0311, 0.0213, 0.1])])
    all_faces = np.vstack([faces, flap_faces + len(vertices)])
    seen = compute_visibility(both, all_faces, FRONTAL)
    image = np.where((seen.face >= len(faces))[..., None], 1.0, np.where((seen.face >= 0)[..., None], 0.0, [1, 0, 0]))
    warp, _, target = warped(image.astype(np.float32), both, moved, all_faces, FRONTAL)
    trusted = (target.face >= 0) & (warp.mask_flags == 0)
    assert trusted.sum() > 500
    np.testing.assert_allclose(warp.colour[trusted].max(axis=1), warp.colour[trusted].min(axis=1), atol=1e-6)
    on_flap = target.face[trusted] >= len(faces)
    np.testing.assert_allclose(warp.colour[trusted][:, 0], on_flap, atol=1e-6)


@settings(max_examples=15, deadline=None)
@given(st.floats(0.8, 1.3), st.floats(-0.3, 0.3), st.floats(-0.004, 0.004), st.floats(0.0, 1.0))
def test_outlines_are_blended_as_the_caricature_covers_their_pixels(scale, shear, shift, background):
    """A sheet of one colour whose frame has a blended outline: so has the target, by its own coverage."""
    vertices, faces = sheet()
    linear = np.array([[scale, shear], [0.1, scale]])
    moved = vertices.copy()
    moved[:, :2] = vertices[:, :2] @ linear.T + shift
    vertices[:, :2] += 0.0037
    ends = [compute_visibility(v, faces, FRONTAL) for v in (vertices, moved)]
    colour = np.array([0.2, 0.9, 0.5])

    def blended(seen):
        share = np.where(seen.face >= 0, seen.coverage(4), 0)[..., None]
        return (share * colour + (1 - share) * background).astype(np.float32)

    face_flags, frame_flags = np.zeros(len(faces), np.uint16), np.zeros((48, 64), np.uint16)
    warp = warp_frame(blended(ends[0]), *ends, face_flags, frame_flags, Gtstar(supersampling=4), background)
    trusted = warp.mask_flags == 0
    assert trusted.sum() > 2500
    np.testing.assert_allclose(warp.colour[trusted], blended(ends[1])[trusted], atol=2e-6)


def test_an_unknown_map_is_refused():
    vertices, faces = sheet()
    with pytest.raises(SettingsError, match="perspective or affine"):
        warped(picture(FRONTAL), vertices, vertices, faces, FRONTAL, warp="projective")


@pytest.mark.parametrize(("growth", "is_stretched"), [(1.3, False), (1.5, True)])
@pytest.mark.parametrize("resolution", [0.5, 1.0, 3.0])
def test_whether_a_triangle_is_stretched_does_not_depend_on_the_target_s_resolution(
    resolution, growth, is_stretched, monkeypatch
):
    """The limit is a ratio of areas of 2, seen at one resolution."""
    monkeypatch.setattr("carigs.gtstar.warp.MAX_STRETCH", 2.0)
    vertices, faces = sheet(3)
    natural = compute_visibility(vertices / growth, faces, FRONTAL)
    caricature = compute_visibility(vertices, faces, FRONTAL.scaled(resolution))
    face_flags, frame_flags = np.zeros(len(faces), np.uint16), np.zeros((FRONTAL.height, FRONTAL.width), np.uint16)
    warp = warp_frame(picture(FRONTAL), natural, caricature, face_flags, frame_flags, Gtstar())
    flags = warp.mask_flags[caricature.face >= 0] & MaskFlag.STRETCHED.value
    assert len(flags) > 0
    assert ((flags > 0) == is_stretched).all()
