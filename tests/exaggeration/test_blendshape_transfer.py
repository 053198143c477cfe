"""Transfer of blendshapes: the map is linear, maps the head to its caricature, and lets lids close."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from shared_data import DATA, needs_data
from surfaces import PLAIN, bumpy, sphere

from carigs.errors import InputError, SettingsError
from carigs.exaggeration import Caricature, Exaggerator, GammaPath, transfer_blendshapes
from carigs.exaggeration.blendshape_transfer import TRANSFER_FACTORS, linear_transfer
from carigs.head import HeadModel, HeadParameters, neutral

SOLVER = Exaggerator(*bumpy(2), PLAIN)
BLENDSHAPES = 0.1 * np.random.default_rng(0).normal(size=(2, len(SOLVER.vertices), 3))


def transferred_path(transfer: str, solver: Exaggerator = SOLVER, blendshapes: np.ndarray = BLENDSHAPES) -> GammaPath:
    solver.settings = replace(solver.settings, blendshape_transfer=transfer)
    return transfer_blendshapes(solver.path(0.25), solver, blendshapes, np.array([4, 9]))


@pytest.mark.parametrize("level", [0.1, 0.25])
def test_the_map_takes_the_head_to_its_caricature(level):
    moved = linear_transfer(SOLVER, SOLVER.vertices, SOLVER.weights(level))
    np.testing.assert_allclose(moved, SOLVER.vertices + SOLVER.solve(level), atol=1e-12)


@settings(max_examples=15)
@given(st.integers(0, 2**32 - 1), st.floats(-3, 3))
def test_the_map_is_linear_and_keeps_translations(seed, factor):
    first, second = np.random.default_rng(seed).normal(size=(2, len(SOLVER.vertices), 3))
    weights = SOLVER.weights(0.25)
    together = linear_transfer(SOLVER, first + factor * second, weights)
    apart = linear_transfer(SOLVER, first, weights) + factor * linear_transfer(SOLVER, second, weights)
    np.testing.assert_allclose(together, apart, atol=1e-10)
    np.testing.assert_allclose(
        linear_transfer(SOLVER, first + 1.0, weights), linear_transfer(SOLVER, first, weights) + 1.0
    )


def test_nodes_hold_the_scaled_change():
    path = transferred_path("mixed")
    for level in path.levels[1:]:
        for blendshape, change in zip(BLENDSHAPES, path.at(level).changes, strict=True):
            expected = TRANSFER_FACTORS["mixed"] * (
                linear_transfer(SOLVER, blendshape, SOLVER.weights(level)) - blendshape
            )
            np.testing.assert_allclose(change, expected, atol=1e-6)
    linear = transferred_path("linear").at(0.1).changes * TRANSFER_FACTORS["mixed"]
    np.testing.assert_allclose(path.at(0.1).changes * TRANSFER_FACTORS["linear"], linear, atol=1e-6)


def test_offset_and_level_zero_change_no_blendshape():
    assert transferred_path("offset").changes is None
    for path in (transferred_path("offset"), transferred_path("linear")):
        natural = path.at(0.0)
        assert not natural.displacement.any()
        assert not natural.blendshape_change(np.ones(20)).any()
    assert transferred_path("linear").at(0.25).blendshape_change(np.eye(20)[4]).any()


def test_coefficients_are_matched_with_their_columns():
    changes = np.random.default_rng(1).normal(size=(3, 5, 3))
    caricature = Caricature(np.zeros((5, 3)), np.array([1, 3, 6]), changes)
    np.testing.assert_allclose(caricature.blendshape_change(np.array([7.0, 2, 7, 3])), 2 * changes[0] + 3 * changes[1])
    np.testing.assert_allclose(caricature.blendshape_change(np.array([7.0, 7, 5]), first=4), 5 * changes[2])


def test_blendshapes_of_a_rigid_component_are_transformed_with_it():
    """A ball that rotates in a bumpy head still rotates as a rigid ball of the new size."""
    vertices, faces = bumpy()
    ball, ball_faces = sphere(2, 0.15)
    centre = np.array([0.3, 0, 0.9])
    both = np.vstack([vertices, ball + centre]), np.vstack([faces, ball_faces + len(vertices)])
    solver = Exaggerator(*both, PLAIN)
    turned = ball @ Rotation.from_rotvec([0.4, 0.1, 0]).as_matrix().T
    roll = np.vstack([np.zeros_like(vertices), turned - ball])
    caricature = transferred_path("linear", solver, roll[None].repeat(2, axis=0)).at(0.25)
    moved = (both[0] + caricature.displacement + roll + caricature.changes[0])[len(vertices) :]
    radii = np.linalg.norm(moved - moved.mean(axis=0), axis=1)
    assert np.ptp(radii) < 1e-6
    assert radii.mean() == pytest.approx(0.15 * solver.report["follower_scales"][0], rel=1e-5)


def test_transferred_blendshapes_survive_the_file(tmp_path):
    path = transferred_path("mixed")
    path.save(tmp_path / "path.npz")
    again = GammaPath.load(tmp_path / "path.npz")
    np.testing.assert_array_equal(again.columns, path.columns)
    np.testing.assert_array_equal(again.changes, path.changes)
    transferred_path("offset").save(tmp_path / "path.npz")
    assert GammaPath.load(tmp_path / "path.npz").changes is None


@pytest.mark.parametrize(
    ("field", "broken"),
    [
        ("changes", {"changes": np.zeros((3, 1, 162, 3), np.float32)}),
        ("changes", {"changes": np.full((3, 2, 162, 3), np.inf, np.float32)}),
        ("changes", {"changes": np.zeros((3, 2, 162, 3), int)}),
        ("columns", {"columns": np.array([4.0, 9.0])}),
    ],
)
def test_broken_blendshapes_are_named(tmp_path, field, broken):
    replace(transferred_path("mixed"), **broken).save(tmp_path / "path.npz")
    with pytest.raises(InputError, match=f"path.npz: {field}"):
        GammaPath.load(tmp_path / "path.npz")


def test_an_unknown_transfer_is_named():
    with pytest.raises(SettingsError, match=r"exaggerate\.blendshape_transfer=half is unknown"):
        Exaggerator(SOLVER.vertices, SOLVER.faces, replace(PLAIN, blendshape_transfer="half"))


@pytest.mark.sample(1)
@pytest.mark.parametrize("seed", [1, 2, 3])
@needs_data
def test_lids_close_as_they_naturally_do(seed):
    """A full blink closes as much of the gap as on the natural head, within 15 %, and more than an offset does."""
    model = HeadModel.load(DATA / "ict_model.npz")
    shape = np.pad(np.random.default_rng(seed).normal(size=30), (0, 270))
    head, names = neutral(model, HeadParameters(shape=shape)), model.expression_names
    columns = [names.index("eyeBlink_L"), names.index("eyeBlink_R")]
    blinks = model.shapedirs[:, :, 300:][:, :, columns].transpose(2, 0, 1).astype(np.float64)
    upper, lower = model.landmarks68[[37, 38, 43, 44]], model.landmarks68[[41, 40, 47, 46]]

    def gap(vertices: np.ndarray) -> float:
        return (upper.interpolate(vertices) - lower.interpolate(vertices))[:, 1].mean()

    def closed(head: np.ndarray, blendshapes: np.ndarray) -> float:
        return 1 - gap(head + blendshapes.sum(axis=0)) / gap(head)

    solver = Exaggerator(head, model.faces)
    path = transfer_blendshapes(solver.path(0.25), solver, blinks, np.arange(2)).at(0.25)
    moved, natural = head + path.displacement, closed(head, blinks)
    mixed, offset = closed(moved, blinks + path.changes), closed(moved, blinks)
    assert abs(mixed / natural - 1) < 0.15
    assert mixed > offset
