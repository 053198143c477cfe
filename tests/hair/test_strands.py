"""Directions of strands, from images alone and inside the hair."""

import numpy as np
import pytest
from hair.hairy_ball import CAP, RADIUS, ball, views
from hypothesis import given, settings
from hypothesis import strategies as st

from carigs.hair import place_in_hair
from carigs.hair.covered_faces import covered_faces
from carigs.hair.hull import Voxels
from carigs.hair.placement import MAX_ELONGATION
from carigs.hair.strands import orientation, strand_directions
from carigs.hair.visible_voxels import visible_shares
from carigs.hair.volume import carve_hair


@given(st.floats(0, np.pi), st.floats(3, 6), st.floats(0.2, 1))
@settings(max_examples=30, deadline=None)
def test_orientation_of_parallel_lines_is_across_them(angle, wavelength, contrast):
    y, x = np.mgrid[:48, :48]
    across = np.cos(angle) * x + np.sin(angle) * y
    image = 0.5 + 0.5 * contrast * np.sin(2 * np.pi * across / wavelength)
    found = orientation(np.repeat(image[..., None], 3, axis=2).astype(np.float32))
    c, s, coherence = (each[10:-10, 10:-10] for each in found)
    assert np.abs(c * np.cos(angle) + s * np.sin(angle)).min() > 0.995
    assert coherence.min() > 0.9


def test_noise_has_no_orientation_and_a_slope_has_no_structure():
    noise = np.random.default_rng(0).normal(0.5, 0.1, (200, 200, 3)).astype(np.float32)
    assert np.median(orientation(noise)[2]) < 0.5
    slope = np.repeat(np.linspace(0, 1, 60, dtype=np.float32)[None, :, None], 60, axis=0) * np.ones(3, np.float32)
    lines = 0.5 * slope + 0.05 * np.sin(2 * np.pi * np.arange(60) / 4)[:, None, None].astype(np.float32)
    assert np.abs(orientation(lines)[1][10:-10, 10:-10]).min() > 0.99  # across the lines, not down the slope


@pytest.fixture(scope="module")
def hair():
    seen = list(views(count=24, scale=2.5))
    vertices, faces = ball()
    cap, none = vertices[faces].mean(axis=1)[:, 1] > CAP * RADIUS, np.zeros(len(faces), bool)
    covering = covered_faces(seen, faces, vertices, cap, none, none)
    return seen, cap, carve_hair(seen, covering, cap, vertices, faces)


def test_strands_along_meridians_are_found(hair):
    seen, cap, volume = hair
    vertices, faces = ball()
    strands = strand_directions(volume, seen, vertices, np.unique(faces[cap]))
    np.testing.assert_allclose(np.linalg.norm(strands.direction, axis=1), 1, atol=1e-5)
    radius, height = np.linalg.norm(volume.centres, axis=1), volume.centres[:, 1] / RADIUS
    shell = (volume.opacity > 0.5) & (radius > RADIUS + 0.006) & (height > CAP + 0.15) & (height < 0.8)
    east = np.cross([0, 1, 0], volume.centres[shell])
    meridian = np.cross(volume.centres[shell], east)
    meridian /= np.linalg.norm(meridian, axis=1, keepdims=True)
    cosine = np.abs(np.einsum("nc,nc->n", strands.direction[shell], meridian))
    assert np.median(cosine) > 0.97 and np.quantile(cosine, 0.1) > 0.8
    assert np.median(strands.confidence[shell]) > 0.5
    visible = visible_shares(volume, seen, vertices, np.unique(faces[cap]))
    outwards = volume.centres / radius[:, None]
    facing = np.einsum("nc,nc->n", strands.facing, outwards)[shell & (visible > 0.2)]
    assert np.quantile(facing, 0.05) > 0.3

    points = place_in_hair(volume, visible, strands, cap, vertices, faces, 500, np.random.default_rng(0))
    square = np.einsum("nij,nik->njk", points.axes, points.axes)
    np.testing.assert_allclose(square, np.broadcast_to(np.eye(2), square.shape), atol=1e-5)
    assert points.elongation.min() >= 1 and points.elongation.max() <= MAX_ELONGATION


def test_no_hair_has_no_strands():
    vertices, faces = ball()
    volume = Voxels(np.zeros((0, 3), np.float32), np.zeros(0, np.float32), 0.004)
    strands = strand_directions(volume, list(views(count=2)), vertices, np.unique(faces))
    assert [len(values) for values in strands] == [0, 0, 0]
