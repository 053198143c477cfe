"""Paths: exact at the nodes, polynomial in between; files are checked when they are read."""

import json
from dataclasses import replace

import numpy as np
import pytest
from surfaces import PLAIN, bumpy

from carigs.errors import InputError
from carigs.exaggeration import Exaggerator, GammaPath, exaggerator, straight_path
from carigs.mesh.triangle_mesh import diagonal


def test_path_is_exact_at_its_nodes_and_polynomial_between():
    vertices, faces = bumpy(2)
    random = np.random.default_rng(5)
    levels, coefficients = np.array([0, 0.0625, 0.1875, 0.25]), random.normal(size=(3, len(vertices), 3))

    def cubic(g):
        return g * coefficients[0] + g**2 * coefficients[1] + g**3 * coefficients[2]

    path = GammaPath(levels, np.stack([cubic(g) for g in levels]).astype(np.float32), faces, vertices)
    for g, node in zip(levels, path.displacements, strict=True):
        np.testing.assert_array_equal(path.displacement(g), node)
    for g in np.linspace(0, 0.25, 9):
        np.testing.assert_allclose(path.displacement(g), cubic(g), atol=1e-6)
        assert path.weights(g).sum() == pytest.approx(1)


def test_a_still_path_moves_nothing_on_the_same_head(tmp_path):
    vertices, faces = bumpy(2)
    path = straight_path(vertices, faces, 0.1 * vertices, 0.3)
    still = path.still()
    assert still.is_still and not path.is_still and still.gamma_f == path.gamma_f
    np.testing.assert_array_equal(still.neutral, path.neutral)
    np.testing.assert_array_equal(still.faces, path.faces)
    for level in (0.0, 0.1, 0.3):
        assert not still.displacement(level).any()
    still.save(tmp_path / "path.npz")
    assert GammaPath.load(tmp_path / "path.npz").is_still


def test_levels_outside_warn():
    vertices, faces = bumpy(2)
    path = straight_path(vertices, faces, 0.1 * vertices, 0.25)
    for level in (0.5, -0.1):
        with pytest.warns(UserWarning, match=r"levels outside \[0, 0.25\]"):
            np.testing.assert_allclose(path.displacement(level), 0.4 * level * vertices, atol=1e-6)


@pytest.mark.parametrize("gamma", [0.25, -0.2])
@pytest.mark.parametrize("requested", [1e-2, 1e-3, 1e-5])
def test_the_path_has_as_many_nodes_as_the_requested_error_needs(gamma, requested, monkeypatch):
    """Between the nodes the error is as small as requested; with one node less it is not."""
    vertices, faces = bumpy(2)

    def error(**options):
        solver = Exaggerator(vertices, faces, replace(PLAIN, **options))
        path, levels = solver.path(gamma), np.linspace(0, gamma, 23)
        distance = [np.linalg.norm(path.displacement(g) - solver.solve(g), axis=1).max() for g in levels]
        return len(path.levels), max(distance) / diagonal(vertices)

    monkeypatch.setattr(exaggerator, "PATH_ERROR", requested)
    count, reached = error()
    assert reached < 1.1 * requested + 1e-6  # the nodes are in float32
    if count > 2:
        assert error(path_nodes=count - 1)[1] > 0.9 * requested


def test_a_path_to_a_negative_level_is_exact_at_its_end(tmp_path):
    solver = Exaggerator(*bumpy(2), PLAIN)
    solver.path(-0.15).save(tmp_path / "path.npz")
    path = GammaPath.load(tmp_path / "path.npz")
    assert path.gamma_f == -0.15
    np.testing.assert_allclose(path.displacement(-0.15), solver.solve(-0.15), atol=1e-6)
    with pytest.warns(UserWarning, match="extrapolated"):
        path.displacement(0.1)


@pytest.fixture(scope="module")
def path() -> GammaPath:
    return Exaggerator(*bumpy(2), PLAIN).path(0.25)


def test_round_trip(path, tmp_path):
    path.save(tmp_path / "path.npz")
    again = GammaPath.load(tmp_path / "path.npz")
    for level in (0.0, 0.13, 0.25):
        np.testing.assert_array_equal(again.displacement(level), path.displacement(level))
    np.testing.assert_array_equal(again.neutral, path.neutral)
    np.testing.assert_array_equal(again.faces, path.faces)
    assert again.report == path.report
    assert [file.name for file in tmp_path.iterdir()] == ["path.npz"]


@pytest.mark.parametrize(
    ("field", "change"),
    [
        ("levels", lambda levels: levels[0]),
        ("levels", lambda levels: levels[::-1]),
        ("levels", lambda levels: levels + 0.1),
        ("levels", lambda levels: np.where(levels == levels[1], np.nan, levels)),
        ("displacements", lambda nodes: nodes[:, :5]),
        ("displacements", lambda nodes: nodes * np.inf),
        ("displacements", lambda nodes: nodes.astype(str)),
        ("displacements", lambda nodes: nodes + 1),
        ("faces", lambda faces: faces[:, :2]),
        ("faces", lambda faces: faces + 1),
        ("faces", lambda faces: faces.astype(float)),
        ("neutral", lambda neutral: neutral[:, 0]),
        ("neutral", lambda neutral: neutral * np.nan),
        ("report", lambda report: np.array("{")),
        ("faces", None),
    ],
)
@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
def test_a_broken_array_is_named(path, tmp_path, field, change):
    arrays = {
        "levels": path.levels,
        "displacements": path.displacements,
        "faces": path.faces,
        "neutral": path.neutral,
        "report": np.array(json.dumps(path.report)),
    }
    value = arrays.pop(field)
    np.savez(tmp_path / "bad.npz", **arrays, **({} if change is None else {field: change(value)}))
    with pytest.raises(InputError, match=rf"bad\.npz: {field}: "):
        GammaPath.load(tmp_path / "bad.npz")


@pytest.mark.parametrize("damage", ["text", "empty", "cut", "flipped", "npy"])
def test_an_unreadable_file_is_named(path, tmp_path, damage):
    path.save(tmp_path / "path.npz")
    data = (tmp_path / "path.npz").read_bytes()
    middle = len(data) // 2
    bad = tmp_path / "bad.npz"
    if damage == "npy":
        with bad.open("wb") as stream:
            np.save(stream, path.neutral)
    else:
        flipped = data[:middle] + bytes([data[middle] ^ 255]) + data[middle + 1 :]
        bad.write_bytes({"text": b"nothing", "empty": b"", "cut": data[:middle], "flipped": flipped}[damage])
    with pytest.raises(InputError, match=r"bad\.npz: .*not a readable"):
        GammaPath.load(bad)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"none\.npz: no such path"):
        GammaPath.load(tmp_path / "none.npz")
