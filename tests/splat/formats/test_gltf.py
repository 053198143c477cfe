"""glTF files, read by struct and json alone: the container, splats, meshes and morph targets."""

import base64
import json
import struct

import numpy as np
import pytest
import trimesh
from avatars import ball_avatar, ball_sequence
from scipy.interpolate import CubicHermiteSpline

from carigs.exaggeration.gamma_path import GammaPath, lobatto_levels
from carigs.splat.colour.spherical_harmonics import SH_BASE
from carigs.splat.formats.gltf_splats import write_gltf_splats
from carigs.splat.formats.head_meshes import posed_path, write_mesh, write_morph_targets
from carigs.splat.formats.world_splats import bake

SIZES = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}
TYPES = {5126: "<f4", 5125: "<u4"}


def read_gltf(file):
    """The document and its buffer; the container is checked against the specification of glTF 2.0."""
    content = file.read_bytes()
    if file.suffix == ".gltf":
        document = json.loads(content)
        prefix = "data:application/octet-stream;base64,"
        assert document["buffers"][0]["uri"].startswith(prefix)
        binary = base64.b64decode(document["buffers"][0]["uri"][len(prefix) :])
    else:
        magic, number, length = struct.unpack_from("<4sII", content)
        assert (magic, number, length) == (b"glTF", 2, len(content))
        size, kind = struct.unpack_from("<I4s", content, 12)
        assert kind == b"JSON" and size % 4 == 0
        document = json.loads(content[20 : 20 + size])
        binary_size, kind = struct.unpack_from("<I4s", content, 20 + size)
        assert kind == b"BIN\0" and binary_size % 4 == 0
        binary = content[28 + size :]
        assert len(binary) == binary_size
    assert document["asset"]["version"] == "2.0"
    assert 0 <= len(binary) - document["buffers"][0]["byteLength"] < 4
    return document, binary


def accessor(document, binary, index):
    entry = document["accessors"][index]
    view = document["bufferViews"][entry["bufferView"]]
    dtype, width = np.dtype(TYPES[entry["componentType"]]), SIZES[entry["type"]]
    assert view["byteOffset"] % 4 == 0 and view["byteLength"] == entry["count"] * width * dtype.itemsize
    array = np.frombuffer(binary, dtype, entry["count"] * width, view["byteOffset"]).reshape(entry["count"], -1)
    if "min" in entry:
        np.testing.assert_array_equal(array.min(axis=0), np.float32(entry["min"]))
        np.testing.assert_array_equal(array.max(axis=0), np.float32(entry["max"]))
    return array


@pytest.mark.parametrize("suffix", ["glb", "gltf"])
@pytest.mark.parametrize("degree", [0, 2, 3])
def test_splats_have_the_attributes_of_the_extension(degree, suffix, tmp_path):
    splats = bake(ball_avatar(sh_degree=degree), 2, 0.25)
    write_gltf_splats(tmp_path / f"a.{suffix}", splats)
    document, binary = read_gltf(tmp_path / f"a.{suffix}")
    assert document["extensionsUsed"] == ["KHR_gaussian_splatting"]
    (primitive,) = document["meshes"][0]["primitives"]
    assert primitive["mode"] == 0
    extension = primitive["extensions"]["KHR_gaussian_splatting"]
    assert (extension["kernel"], extension["colorSpace"]) == ("ellipse", "srgb_rec709_display")
    values = {name: accessor(document, binary, index) for name, index in primitive["attributes"].items()}
    assert {"min", "max"} <= set(document["accessors"][primitive["attributes"]["POSITION"]])
    prefix = "KHR_gaussian_splatting:"
    names = {"POSITION", "COLOR_0", f"{prefix}ROTATION", f"{prefix}SCALE", f"{prefix}OPACITY"}
    k = 0
    for band in range(degree + 1):
        for i in range(2 * band + 1):
            names.add(f"{prefix}SH_DEGREE_{band}_COEF_{i}")
            expected = splats.colour if band == 0 else splats.harmonics[:, k - 1]
            np.testing.assert_allclose(values[f"{prefix}SH_DEGREE_{band}_COEF_{i}"], expected, atol=1e-5)
            k += 1
    assert set(values) == names
    np.testing.assert_allclose(values["POSITION"], splats.centre, atol=1e-7)
    x, y, z, w = values[f"{prefix}ROTATION"].T
    np.testing.assert_allclose(np.stack([w, x, y, z], axis=1), splats.rotation, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(values[f"{prefix}ROTATION"], axis=1), 1, atol=1e-6)
    np.testing.assert_allclose(values[f"{prefix}SCALE"][:, :2], splats.scale, rtol=1e-6)  # linear, not logarithms
    assert (values[f"{prefix}SCALE"] > 0).all()
    np.testing.assert_allclose(values[f"{prefix}OPACITY"][:, 0], splats.opacity, atol=1e-6)
    np.testing.assert_allclose(values["COLOR_0"][:, :3], (0.5 + SH_BASE * splats.colour).clip(0, 1), atol=1e-6)


@pytest.mark.parametrize("suffix", ["obj", "ply", "glb"])
def test_meshes_are_the_posed_head_of_the_level(suffix, tmp_path):
    sequence = ball_sequence(lit=False)
    write_mesh(tmp_path / f"a.{suffix}", posed_path(sequence, 2), 0.17)
    mesh = trimesh.load(tmp_path / f"a.{suffix}", process=False, maintain_order=True, force="mesh")
    np.testing.assert_allclose(mesh.vertices, sequence.posed(2, 0.17), atol=1e-7)
    np.testing.assert_array_equal(mesh.faces, sequence.head.faces)


def read_morph(file):
    document, binary = read_gltf(file)
    mesh = document["meshes"][0]
    (primitive,) = mesh["primitives"]
    base = accessor(document, binary, primitive["attributes"]["POSITION"])
    targets = np.stack([accessor(document, binary, target["POSITION"]) for target in primitive["targets"]])
    normals = [accessor(document, binary, target["NORMAL"]) for target in primitive["targets"]]
    assert all(len(normal) == len(base) for normal in normals)
    faces = accessor(document, binary, primitive["indices"]).reshape(-1, 3)
    sampler = document["animations"][0]["samplers"][0]
    (channel,) = document["animations"][0]["channels"]
    assert channel["target"] == {"node": 0, "path": "weights"} and sampler["interpolation"] == "CUBICSPLINE"
    times = accessor(document, binary, sampler["input"])[:, 0]
    keyframes = accessor(document, binary, sampler["output"]).reshape(len(times), 3, len(targets))
    # Of glTF's cubic splines: tangent from the left, value, tangent to the right; both are equal here.
    np.testing.assert_array_equal(keyframes[:, 0], keyframes[:, 2])
    spline = CubicHermiteSpline(times, keyframes[:, 1].astype(np.float64), keyframes[:, 2].astype(np.float64))
    return mesh, base.astype(np.float64), targets.astype(np.float64), faces, times, spline


@pytest.mark.parametrize("timestep", [0, 2])
def test_morph_targets_give_every_level_of_the_posed_head(timestep, tmp_path):
    """The mesh at time t of the animation is the head at the level t / duration gamma_f, posed anew."""
    sequence = ball_sequence(lit=False)
    write_morph_targets(tmp_path / "a.glb", posed_path(sequence, timestep), 0.1)
    mesh, base, targets, faces, times, spline = read_morph(tmp_path / "a.glb")
    assert len(times) == 2  # four nodes: a cubic
    np.testing.assert_array_equal(faces, sequence.head.faces)
    moved = np.abs(sequence.posed(timestep, 0.25) - sequence.posed(timestep, 0)).max()
    assert moved > 0.005
    for fraction in np.linspace(0, 1, 12):
        level = 0.25 * fraction
        shown = base + np.tensordot(spline(fraction * times[-1]), targets, axes=1)
        np.testing.assert_allclose(shown, sequence.posed(timestep, level), atol=1e-6)
    shown = base + np.tensordot(mesh["weights"], targets, axes=1)
    np.testing.assert_allclose(shown, sequence.posed(timestep, 0.1), atol=1e-6)
    np.testing.assert_allclose(mesh["extras"]["levels"], sequence.path.levels)
    assert len(mesh["extras"]["targetNames"]) == len(targets)


@pytest.mark.parametrize(("nodes", "gamma"), [(2, 0.25), (3, -0.2), (7, 0.4)])
def test_paths_of_any_number_of_nodes_are_animated(nodes, gamma, tmp_path):
    rng = np.random.default_rng(nodes)
    levels, ball = lobatto_levels(nodes, gamma), trimesh.creation.icosphere(subdivisions=1, radius=0.1)
    displacements = 0.01 * rng.normal(size=(nodes, *ball.vertices.shape)).astype(np.float32)
    displacements[0] = 0
    path = GammaPath(levels, displacements, np.asarray(ball.faces), np.asarray(ball.vertices))
    write_morph_targets(tmp_path / "a.glb", path, gamma)
    _, base, targets, _, times, spline = read_morph(tmp_path / "a.glb")
    for fraction in np.linspace(0, 1, 23):
        shown = base + np.tensordot(spline(fraction * times[-1]), targets, axes=1)
        expected = path.neutral + path.displacement(gamma * fraction)
        np.testing.assert_allclose(shown, expected, atol=1e-6 if nodes <= 4 else 1e-5)
