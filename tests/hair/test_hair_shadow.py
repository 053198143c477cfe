"""The shadow of hair: the law of Beer and Lambert through a slab, and cubes that the scalp carries."""

import numpy as np
import pytest
from hair.hairy_ball import CAP, RADIUS, ball
from miniature import sheet
from scipy.spatial.transform import Rotation

from carigs.errors import InputError
from carigs.hair import FoundHair, HairShadow, hair_shadow
from carigs.hair.hair_shadow import WIDTH, hair_shadow_of
from carigs.hair.hull import Voxels
from carigs.hair.strands import Strands
from carigs.light import light_transfer

UP = np.array([[0.0, 0, 1]])


def grid(low, high):
    """Centres of cubes that fill a box, whose corners are multiples of their edge."""
    axes = [np.arange(round((b - a) / WIDTH)) * WIDTH + a + WIDTH / 2 for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def shadow_over(vertices, points, thickness):
    corners = np.tile(np.int32([0, 1, len(vertices) - 1]), (len(points), 1))
    none = np.zeros(len(vertices), bool)
    return HairShadow(
        points.astype(np.float32), np.full(len(points), thickness, np.float32), corners,
        vertices.astype(np.float32), none,
    )  # fmt: skip


@pytest.mark.parametrize("layers", [1, 3])
def test_light_through_a_slab_falls_exponentially(layers):
    """From straight above: each layer lets exp(-thickness) pass; beside the slab, the sheet is lit."""
    floor, faces = sheet(41, 0.2, 0.2)
    top = 0.024 + layers * WIDTH
    slab = grid((-0.12, -0.12, 0.024), (0.0, 0.12, top))
    bare = light_transfer(floor, faces, UP)
    shaded = light_transfer(floor, faces, UP, shadow_over(floor, slab, 0.4))
    inside = np.abs(floor).max(axis=1) < 0.09
    inner, outer = inside & (floor[:, 0] < -0.01), inside & (floor[:, 0] > 0.01)
    np.testing.assert_allclose(shaded[inner, 0], np.exp(-0.4 * layers) * bare[inner, 0], rtol=1e-4)
    np.testing.assert_array_equal(shaded[outer, 0], bare[outer, 0])
    np.testing.assert_array_equal(shaded[:, 1], bare[:, 1])  # the head hides no more than before


def test_hair_behind_the_surface_shades_nothing():
    floor, faces = sheet(21, 0.2, 0.2)
    slab = grid((-0.12, -0.12, -0.04), (0.12, 0.12, -0.024))
    bare = light_transfer(floor, faces, UP)
    np.testing.assert_array_equal(light_transfer(floor, faces, UP, shadow_over(floor, slab, 1.0)), bare)


def test_a_turned_head_in_turned_light_has_the_same_shadow():
    vertices, faces = ball()
    hair = shadow_over(vertices, grid((-0.08, 0.12, -0.08), (0.08, 0.144, 0.08)), 0.3)
    lamp = np.array([0.3, 0.9, 0.2]) / np.linalg.norm([0.3, 0.9, 0.2])
    turn = Rotation.from_rotvec([0.4, -0.8, 0.3]).as_matrix()
    before = light_transfer(vertices, faces, lamp[None], hair)[:, 0]
    after = light_transfer(vertices @ turn.T + [0.2, 0, 1], faces, (turn @ lamp)[None], hair)[:, 0]
    bare = light_transfer(vertices, faces, lamp[None])[:, 0]
    dark = before < 0.6 * bare
    assert dark[bare > 1].mean() > 0.3
    # The cubes are drawn as squares that face the light: in another direction they overlap elsewhere.
    np.testing.assert_allclose(after[dark].mean(), before[dark].mean(), rtol=0.08)
    np.testing.assert_allclose(after[~dark].mean(), before[~dark].mean(), rtol=0.02)


def found(points, opacity, hidden, covered):
    n, f = len(points), len(ball()[1])
    volume = Voxels(points.astype(np.float32), np.full(n, opacity, np.float32), WIDTH / 2)
    visible = np.ones(n, np.float32)
    strands = Strands(np.tile(np.float32([0, 1, 0]), (n, 1)), visible, np.tile(np.float32([0, 0, 1]), (n, 1)))
    return FoundHair(np.zeros(f, np.float32), covered, hidden, ~covered, volume, visible, strands)


def voxels():
    """Eight to a cube."""
    centres = grid((-0.04, 0.104, -0.04), (0.04, 0.12, 0.04))
    steps = np.stack(np.meshgrid(*[(-WIDTH / 4, WIDTH / 4)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    return centres, (centres[:, None] + steps).reshape(-1, 3)


def test_voxels_are_collected_into_cubes_that_hang_on_the_scalp():
    vertices, faces = ball()
    scalp = vertices[faces].mean(axis=1)[:, 1] > CAP * RADIUS
    centres, points = voxels()
    hidden = np.arange(len(faces)) < 7
    shadow = hair_shadow(found(points, 0.5, hidden, scalp), scalp, vertices, faces, 30.0)
    order = np.lexsort(shadow.points.T), np.lexsort(centres.T)
    np.testing.assert_allclose(shadow.points[order[0]], centres[order[1]], atol=1e-6)
    np.testing.assert_allclose(shadow.thickness, 30.0 * WIDTH * 0.5, rtol=1e-5)
    assert np.isin(shadow.corners, faces[scalp]).all()
    assert set(np.flatnonzero(shadow.lit)) == set(np.unique(faces[hidden & ~scalp]))
    turn = Rotation.from_rotvec([0.2, 0.5, -0.3]).as_matrix()
    np.testing.assert_allclose(shadow.over(vertices @ turn.T + 1), shadow.points @ turn.T + 1, atol=1e-6)
    grown = vertices * np.where(vertices[:, 1:2] < 0, 1.5, 1.0)  # below the scalp
    np.testing.assert_allclose(shadow.over(grown), shadow.points, atol=1e-6)


def test_bald_heads_and_hair_that_casts_no_shadow_have_none():
    vertices, faces = ball()
    scalp, none = vertices[faces].mean(axis=1)[:, 1] > CAP * RADIUS, np.zeros(len(faces), bool)
    _, points = voxels()
    assert hair_shadow(found(points, 0.5, none, none), scalp, vertices, faces, 30.0) is None
    assert hair_shadow(found(points, 0.5, none, scalp), scalp, vertices, faces, 0.0) is None


@pytest.mark.parametrize(
    ("name", "value"), [("points", np.inf), ("points", 1e9), ("thickness", -1.0), ("corners", 10**6), ("lit", 2)]
)
def test_the_arrays_come_back_and_are_checked(name, value, tmp_path):
    vertices, _ = ball()
    shadow = shadow_over(vertices, voxels()[0], 0.2)
    arrays = shadow.as_arrays()
    again = hair_shadow_of(arrays, vertices, tmp_path / "avatar.npz")
    for field in ("points", "thickness", "corners", "lit", "canonical"):
        np.testing.assert_array_equal(getattr(again, field), getattr(shadow, field))
    array = arrays[f"hair_shadow_{name}"].astype(float)
    array.flat[0] = value
    with pytest.raises(InputError, match=f"hair_shadow_{name}"):
        hair_shadow_of({**arrays, f"hair_shadow_{name}": array}, vertices, tmp_path / "avatar.npz")
