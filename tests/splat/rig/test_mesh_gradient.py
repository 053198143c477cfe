"""Gradients of the posed vertices, from those of the records of the motion."""

import numpy as np
import pytest
import torch
import trimesh

from carigs.errors import MeshError
from carigs.splat.rig.face_motion import RECORD_SIZE, RELATIVE_ROTATION
from carigs.splat.rig.mesh_gradient import differentiable_face_motion, vertices_gradient
from carigs.splat.rig.rig import build_rig, face_motion, motion_records, polar_decomposition


@pytest.fixture(scope="module")
def ball():
    mesh = trimesh.creation.icosphere(subdivisions=1, radius=0.1)
    return np.asarray(mesh.vertices) * [1.0, 1.3, 0.8], np.asarray(mesh.faces)


def twisted(vertices, by):
    """Rotate triangles by up to `by` radians, neighbours by different angles."""
    x, y, z = vertices.T
    angle = by * y / 0.13
    return np.stack([x * np.cos(angle) - z * np.sin(angle), 1.2 * y + x * x, x * np.sin(angle) + z * np.cos(angle)], 1)


@pytest.mark.parametrize("by", [0.0, 1e-3, 0.5, 3.0])
def test_gradient_of_the_vertices_is_that_of_finite_differences(ball, by):
    vertices, faces = ball
    rig, rng = build_rig(vertices, faces), np.random.default_rng(0)
    posed = twisted(vertices, by) + 0.004 * rng.normal(size=vertices.shape)
    weights = rng.normal(size=(len(faces), RECORD_SIZE))
    weights[:, RELATIVE_ROTATION + 9 :] = 0  # padding

    def value(vertices):
        centre, rotation, stretch, _ = polar_decomposition(rig, vertices)
        return float((weights * motion_records(rig, centre, rotation, stretch, np.float64)).sum())

    centre, rotation, stretch, sound = polar_decomposition(rig, posed)
    records = motion_records(rig, centre, rotation, stretch, np.float64)
    gradient = vertices_gradient(weights, rig, posed, rotation, stretch, sound, records)
    for _ in range(10):
        step = rng.normal(size=posed.shape)
        h = 1e-7 / np.abs(step).max()
        difference = (value(posed + h * step) - value(posed - h * step)) / (2 * h)
        assert (gradient * step).sum() == pytest.approx(difference, rel=2e-5, abs=1e-6 * np.abs(gradient).max())


def test_records_equal_those_of_face_motion(ball):
    vertices, faces = ball
    rig = build_rig(vertices, faces)
    posed = twisted(vertices, 0.7)
    motion = differentiable_face_motion(rig, torch.from_numpy(posed).requires_grad_(True))
    np.testing.assert_array_equal(motion.records.detach().numpy(), face_motion(rig, posed).records)


def test_an_error_names_the_vertex_that_is_not_finite(ball):
    vertices, faces = ball
    posed = torch.from_numpy(vertices).clone()
    posed[7, 1] = torch.nan
    with pytest.raises(MeshError, match="vertex 7"):
        differentiable_face_motion(build_rig(vertices, faces), posed)


def test_a_triangle_without_area_passes_the_gradient_of_its_centre_alone(ball):
    vertices, faces = ball
    rig = build_rig(vertices, faces)
    flat = vertices.copy()
    flat[faces[0, 2]] = vertices[faces[0, :2]].mean(axis=0)
    posed = torch.from_numpy(flat).requires_grad_(True)
    records = differentiable_face_motion(rig, posed).records
    only = torch.zeros_like(records)
    only[0, :] = 1
    only[0, RELATIVE_ROTATION:] = 0  # relative rotations depend on the neighbours, too
    records.backward(only)
    expected = np.zeros_like(flat)
    expected[faces[0]] = 1 / 3
    np.testing.assert_allclose(posed.grad.numpy(), expected, atol=1e-7)
