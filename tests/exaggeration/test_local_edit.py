"""Regions: local edits with the rest held, without a crease; levels of their own; sliders that add up."""

from dataclasses import replace

import numpy as np
import pytest
from surfaces import PLAIN, bumpy, sphere

from carigs.errors import SettingsError
from carigs.exaggeration import Exaggerator
from carigs.mesh.regions import vertex_field
from carigs.mesh.triangle_mesh import diagonal, face_normals
from carigs.settings import Exaggerate

VERTICES, FACES = bumpy(4)
TOP = VERTICES[:, 2] > 0.9 * VERTICES[:, 2].max()
SIDE = np.flatnonzero(VERTICES[:, 0] > 0.9 * VERTICES[:, 0].max())
REGIONS = {"top": TOP, "side": SIDE}


def solver(mode: str = "soft", **options) -> Exaggerator:
    return Exaggerator(VERTICES, FACES, replace(PLAIN, region_constraint=mode, **options), regions=REGIONS)


def bends(vertices: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Degrees between the normals of neighbouring faces."""
    a, b = face_normals(vertices, FACES)[pairs.T]
    return np.degrees(np.arccos(np.clip((a * b).sum(axis=1), -1, 1)))


@pytest.mark.parametrize("mode", ["soft", "exact", "literal"])
def test_the_region_moves_and_the_rest_is_held(mode):
    edit = solver(mode).local_edit("top")
    moved = np.linalg.norm(edit.solve(0.25), axis=1) / diagonal(VERTICES)
    outside = edit.field == 0
    assert 0.2 < outside.mean() < 0.99
    assert moved[TOP].max() > 5e-3
    assert moved[outside].max() <= (1e-3 if mode == "soft" else 0.0)
    assert not edit.solve(0.0).any()


def test_an_eyeball_at_the_edge_of_an_exact_region_stays_exactly():
    """In a socket inside the region it moves."""
    ball, more = sphere(2, 0.15)
    centre = VERTICES[VERTICES[:, 2].argmax()]
    socket = np.linalg.norm(VERTICES - centre, axis=1) < 0.4
    beside = socket & (VERTICES[:, 0] > centre[0] + 0.12)
    both, faces = np.vstack([VERTICES, ball + centre]), np.vstack([FACES, more + len(VERTICES)])
    eye = Exaggerator(both, faces, replace(PLAIN, region_constraint="exact"))
    assert eye.rigid_components
    for region, follows in ((socket, True), (beside, False)):
        edit = eye.local_edit(np.flatnonzero(region))
        displacement = edit.solve(0.25)
        assert displacement[eye.rigid_components[0].surrounding].any()  # the ramp reaches the socket
        assert displacement[len(VERTICES) :].any() == follows


def test_the_border_has_no_crease():
    """Across the edges where the field ends, the angle between faces changes by far less than in the literal mode."""
    changes = {}
    for name in ("soft", "literal"):
        edit = solver(name).local_edit("top")
        first, second = FACES, FACES[:, [1, 2, 0]]
        edges = {}
        for f, face in enumerate(np.sort(np.stack([first, second], axis=-1), axis=-1)):
            for edge in map(tuple, face):
                edges.setdefault(edge, []).append(f)
        border = [(e, p) for e, p in edges.items() if (edit.field[e[0]] > 0) != (edit.field[e[1]] > 0)]
        pairs = np.array([p for _, p in border])
        change = np.abs(bends(VERTICES + edit.solve(0.25), pairs) - bends(VERTICES, pairs))
        changes[name] = np.percentile(change, 95)
    assert changes["soft"] < 0.5 * changes["literal"]


def test_exact_and_literal_solve_the_constrained_least_squares():
    """Both are the minimum of equation 4: no displacement of the free vertices makes the residual smaller."""
    for mode in ("exact", "literal"):
        head = solver(mode)
        edit = head.local_edit("top")
        delta_weights = edit.weights(0.25) - 1
        free, x = edit.field > 0, edit.response(delta_weights)

        def residual(u, head=head, delta_weights=delta_weights):
            r = head.system @ u - head.weighted_divergence(delta_weights)
            return (r**2 / head.areas[:, None]).sum()

        random, least = np.random.default_rng(0), residual(x)
        for _ in range(5):
            step = np.where(free[:, None], random.normal(size=x.shape), 0.0)
            t = 1e-4 * np.abs(x).max()
            assert residual(x + t * step) > least
            assert residual(x - t * step) > least
            slope = (residual(x + t * step) - residual(x - t * step)) / (2 * t)
            curve = residual(x + t * step) + residual(x - t * step) - 2 * least
            assert abs(slope) * t < 1e-3 * curve


def test_a_region_on_its_own_is_the_path_of_that_region():
    head = solver()
    path = head.path(0.25, region="side")
    for level in (0.0, 0.1, 0.25):
        error = np.linalg.norm(path.displacement(level) - head.local_edit("side").solve(level), axis=1).max()
        assert error < 1.1e-4 * diagonal(VERTICES)
    np.testing.assert_array_equal(head.path(0.25, region=SIDE).displacements, path.displacements)


def test_sliders_are_independent_and_add_up():
    """The sum solves one equation for both regions: their right-hand sides have no face in common."""
    head = solver()
    sliders = head.region_paths(0.25)
    assert set(sliders.paths) == {"top", "side"}
    both = sliders.displacement({"top": 0.25, "side": 0.125})
    np.testing.assert_array_equal(
        both, sliders.paths["top"].displacement(0.25) + sliders.paths["side"].displacement(0.125)
    )
    assert not sliders.displacement({}).any()
    together = head.regions.field("top") * 0.25 + head.regions.field("side") * 0.125
    delta_weights = [head.local_edit(name).weights(level) - 1 for name, level in (("top", 0.25), ("side", 0.125))]
    np.testing.assert_allclose(
        sum(delta_weights), head.face_mean(np.exp(together * head.log_curvature)) - 1, atol=1e-12
    )
    with pytest.raises(SettingsError, match=r"no slider chin; known: side, top"):
        sliders.displacement({"chin": 0.1})


def test_regions_with_the_level_of_the_rest_change_nothing():
    head = solver()
    np.testing.assert_allclose(head.solve(0.25, {"top": 0.25}), head.solve(0.25), atol=1e-12)
    path = head.path(0.25, levels={"top": 0.0})
    assert path.displacement(0.25)[TOP].std() != pytest.approx(head.solve(0.25)[TOP].std(), rel=1e-2)
    np.testing.assert_allclose(path.displacement(0.25), head.solve(0.25, {"top": 0.0}), atol=1e-6)


def test_a_region_at_level_zero_has_the_weights_of_level_zero():
    """w = 1 inside, the rest as without regions beyond the ramp."""
    head = solver(normalize_weights=False)
    rates = 1 - head.regions.field("top")
    weights, inside = head.weights(0.25, rates), TOP[FACES].all(axis=1)
    np.testing.assert_array_equal(weights[inside], 1)
    beyond = (rates[FACES] == 1).all(axis=1)
    np.testing.assert_array_equal(weights[beyond], head.weights(0.25)[beyond])
    np.testing.assert_allclose(head.response(weights - 1), head.solve(0.25, {"top": 0.0}), atol=1e-13)


def test_masks_lists_and_painted_scalars_are_regions():
    v = len(VERTICES)
    np.testing.assert_array_equal(vertex_field(TOP, v), vertex_field(np.flatnonzero(TOP), v))
    painted = np.clip(VERTICES[:, 2], 0, 1)
    np.testing.assert_array_equal(solver().regions.field(painted), painted)
    field = solver().regions.field("top")
    assert (field[TOP] == 1).all()
    assert ((field > 0) & (field < 1)).any()
    for a, b in FACES[:, :2]:  # smooth: no jump along an edge
        assert abs(field[a] - field[b]) < 0.75


@pytest.mark.parametrize(
    "region", [[], [-1], [10**6], [0.5], np.zeros(len(VERTICES), bool), np.full(len(VERTICES), 2.0), [[1, 2]], ["nose"]]
)
def test_invalid_regions_are_refused(region):
    with pytest.raises(SettingsError, match="the region"):
        solver().local_edit(region)


def test_a_plural_stands_for_left_and_right():
    head = Exaggerator(
        VERTICES, FACES, PLAIN, regions={"left_ear": SIDE, "right_ear": np.flatnonzero(TOP), "nose": TOP}
    )
    np.testing.assert_array_equal(head.regions.field("ears"), head.regions.field(np.union1d(SIDE, np.flatnonzero(TOP))))
    with pytest.raises(SettingsError, match="region noses is unknown"):
        head.regions.field("noses")


def test_unknown_names_say_which_are_known_and_where_names_come_from():
    with pytest.raises(SettingsError, match=r"region nose is unknown; known: side, top \(they come with"):
        solver().path(0.25, region="nose")
    with pytest.raises(SettingsError, match="this mesh came without any"):
        Exaggerator(VERTICES, FACES, PLAIN).solve(0.25, {"nose": 0.4})


def test_a_region_that_leaves_nothing_to_hold_it_is_refused():
    for mode in ("soft", "exact", "literal"):
        with pytest.raises(SettingsError, match="the region covers a whole component"):
            solver(mode).local_edit(np.ones(len(VERTICES), bool))
    with pytest.raises(SettingsError, match="region all covers a whole component"):
        Exaggerator(VERTICES, FACES, PLAIN, regions={"all": np.ones(len(VERTICES), bool)}).local_edit("all")
    with pytest.raises(SettingsError, match=r"regions \(top\) need a head at a level other than 0.*region_paths"):
        solver().solve(0.0, {"top": 0.1})


def test_local_edits_do_not_depend_on_the_unit():
    for mode in ("soft", "exact"):
        big = Exaggerator(
            1e3 * VERTICES, FACES, Exaggerate(limit_cavities=False, gap_stiffness=0, region_constraint=mode)
        )
        np.testing.assert_allclose(
            big.local_edit(TOP).solve(0.25), 1e3 * solver(mode).local_edit(TOP).solve(0.25), atol=1e-6
        )
