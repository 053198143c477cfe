"""Files of world-space splats, read by struct and NumPy alone: layouts, activations, and the same splats."""

import struct

import numpy as np
import pytest
from avatars import ball_avatar
from ply_oracle import parse_ply, stack
from scipy.spatial.transform import Rotation

from carigs.splat.colour.spherical_harmonics import SH_BASE
from carigs.splat.formats.splat_files import THICKNESS, write_2dgs_ply, write_3dgs_ply, write_splat
from carigs.splat.formats.world_splats import bake

INRIA = (
    ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"]
    + [f"f_rest_{i}" for i in range(45)]
    + ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
)


@pytest.fixture(scope="module", params=[0, 1, 3])
def splats(request):
    return bake(ball_avatar(sh_degree=request.param), 1, 0.2)


def covariance(quaternion, scale):
    """R S S R^T from quaternions wxyz of any length."""
    axes = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()[:, :, : scale.shape[1]] * scale[:, None]
    return axes @ axes.transpose(0, 2, 1)


@pytest.mark.parametrize("scales", [2, 3])
def test_ply_has_the_published_properties_and_the_same_splats(splats, scales, tmp_path):
    (write_2dgs_ply if scales == 2 else write_3dgs_ply)(tmp_path / "a.ply", splats)
    columns, header = parse_ply(tmp_path / "a.ply")
    assert list(columns) == [name for name in INRIA if scales == 3 or name != "scale_2"]
    assert ("comment SplatRenderMode: 2dgs" in header) == (scales == 2)
    centre = np.stack([columns[axis] for axis in "xyz"], axis=1)
    np.testing.assert_allclose(centre, splats.centre, atol=1e-7)
    scale = np.exp(stack(columns, "scale", scales))
    if scales == 3:
        np.testing.assert_allclose(scale[:, 2], THICKNESS, rtol=1e-5)
    expected = covariance(splats.rotation, splats.scale)
    size = np.linalg.norm(expected, axis=(1, 2))[:, None, None]
    np.testing.assert_allclose(covariance(stack(columns, "rot", 4), scale) / size, expected / size, atol=1e-5)
    np.testing.assert_allclose(1 / (1 + np.exp(-columns["opacity"])), splats.opacity, atol=1e-6)
    np.testing.assert_allclose(stack(columns, "f_dc", 3), splats.colour, atol=1e-5)
    rest = stack(columns, "f_rest", 45).reshape(-1, 3, 15)  # all red coefficients, then green, then blue
    for k in range(15):
        expected = splats.harmonics[:, k] if k < splats.harmonics.shape[1] else 0
        np.testing.assert_allclose(rest[:, :, k], expected, atol=1e-5)


def test_records_of_a_splat_file(splats, tmp_path):
    write_splat(tmp_path / "a.splat", splats)
    content = (tmp_path / "a.splat").read_bytes()
    records = list(struct.iter_unpack("<6f8B", content))
    assert len(content) == 32 * len(splats.centre)
    # Records are sorted for viewers that load progressively: the position tells which splat each one is.
    position = np.array([record[:3] for record in records])
    distance = np.linalg.norm(position[:, None] - splats.centre[None], axis=2)
    index = distance.argmin(axis=1)
    assert len(np.unique(index)) == len(index) and distance.min(axis=1).max() < 1e-7
    weight = (splats.scale.prod(axis=1) * splats.opacity)[index]
    assert (np.diff(weight) <= 0).all()
    scale = np.array([record[3:6] for record in records])
    np.testing.assert_allclose(scale[:, :2], splats.scale[index], rtol=1e-6)
    np.testing.assert_allclose(scale[:, 2], THICKNESS)
    rgba = np.array([record[6:10] for record in records]) / 255
    np.testing.assert_allclose(rgba[:, :3], (0.5 + SH_BASE * splats.colour[index]).clip(0, 1), atol=0.5001 / 255)
    np.testing.assert_allclose(rgba[:, 3], splats.opacity[index], atol=0.5001 / 255)
    quaternion = (np.array([record[10:14] for record in records]) - 128) / 128
    angle = (Rotation.from_quat(quaternion, scalar_first=True).inv() * Rotation.from_quat(
        splats.rotation[index], scalar_first=True
    )).magnitude()  # fmt: skip
    assert angle.max() < 0.03  # 8 bits: half a step of 1/128 in each of four components
