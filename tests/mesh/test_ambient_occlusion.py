"""Ambient occlusion on known surfaces, its invariances, and its cache on disk."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from surfaces import bumpy, sphere

from carigs.mesh import ambient_occlusion as ambient_occlusion_module
from carigs.mesh.ambient_occlusion import ambient_occlusion


def test_occlusion_outside_and_inside_a_sphere():
    """Nothing is hidden outside a sphere, everything inside; equal meshes give equal bytes."""
    vertices, faces = sphere(4)
    assert ambient_occlusion(vertices, faces).max() < 0.02
    assert ambient_occlusion(vertices, faces[:, ::-1]).min() > 0.99  # a ray through an edge may slip out
    dented = vertices * (1 - 0.5 * (vertices[:, 2:] > 0.9))
    assert ambient_occlusion(dented, faces).tobytes() == ambient_occlusion(dented, faces).tobytes()


@pytest.mark.parametrize("scale", [2.0**-10, 2.0**-3, 2.0**10])
def test_occlusion_does_not_depend_on_the_unit(scale):
    """libigl drops small triangles by an absolute tolerance; the mesh is scaled against that."""
    vertices, faces = bumpy()
    hidden = ambient_occlusion(vertices, faces)
    assert hidden.max() > 0.1  # not convex
    np.testing.assert_array_equal(ambient_occlusion(scale * vertices, faces), hidden)


def test_occlusion_at_selected_vertices():
    """The other vertices still occlude."""
    vertices, faces = sphere(2)
    both, all_faces = np.vstack([0.5 * vertices, vertices]), np.vstack([faces, faces + len(vertices)])
    inner = np.arange(len(both)) < len(vertices)
    hidden = ambient_occlusion(both, all_faces, at=inner)
    np.testing.assert_array_equal(hidden[inner], ambient_occlusion(both, all_faces)[inner])
    assert hidden[inner].min() > 0.99
    assert not hidden[~inner].any()


def test_occlusion_does_not_depend_on_rotation():
    vertices, faces = bumpy()
    # The shear breaks the mirror symmetries, at which hits on edges are ambiguous.
    vertices = vertices @ np.array([[1, 0.1, 0.2], [0, 1, 0.1], [0, 0, 1]])
    turn = Rotation.from_rotvec([0.3, 1.0, -2.0]).as_matrix()
    expected = ambient_occlusion(vertices, faces)
    np.testing.assert_allclose(ambient_occlusion(vertices @ turn.T + 100, faces), expected, atol=1e-12)


@pytest.mark.parametrize("damage", [None, b"", b"nothing", "shape", "nan"])
def test_occlusion_is_cached_and_a_broken_entry_is_computed_again(damage, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    vertices, faces = bumpy(2)
    every = np.ones(len(vertices), bool)
    expected = ambient_occlusion_module.cached_ambient_occlusion(vertices, faces, every)
    np.testing.assert_array_equal(expected, ambient_occlusion(vertices, faces))
    (entry,) = (tmp_path / "carigs/occlusion").iterdir()
    if isinstance(damage, bytes):
        entry.write_bytes(damage)
    elif damage:
        np.save(entry, expected[1:] if damage == "shape" else expected * np.nan)
    else:
        monkeypatch.setattr(ambient_occlusion_module, "ambient_occlusion", None)  # must not be called
    np.testing.assert_array_equal(ambient_occlusion_module.cached_ambient_occlusion(vertices, faces, every), expected)


def test_each_mesh_has_an_entry_and_an_unwritable_cache_is_ignored(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    vertices, faces = sphere(1)
    every = np.ones(len(vertices), bool)
    for mesh in (vertices, 1.5 * vertices):
        ambient_occlusion_module.cached_ambient_occlusion(mesh, faces, every)
    assert len(list((tmp_path / "carigs/occlusion").iterdir())) == 2
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    ambient_occlusion_module.cached_ambient_occlusion(vertices, faces, every)
