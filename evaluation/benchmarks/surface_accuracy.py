"""Errors of the exaggeration where the truth is known: curvature, the sphere law, paths, bounds, lids."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import igl
import numpy as np
import trimesh
from jaxtyping import Float, Int
from omegaconf import OmegaConf

from carigs.config import compose
from carigs.exaggeration import Exaggerator, GammaPath, transfer_blendshapes
from carigs.exaggeration.blend_bound import blend_bounds
from carigs.exaggeration.blendshape_transfer import TRANSFER_FACTORS
from carigs.head import HeadModel, HeadParameters, neutral
from carigs.mesh.cotan_laplacian import CotanLaplacian, mixed_voronoi_areas
from carigs.mesh.curvature import angle_defects, diffuse_heat
from carigs.mesh.triangle_mesh import boundary_vertices, diagonal, size
from carigs.settings import Exaggerate
from evaluation.benchmarks.measurements import Measurement, seconds

GAMMA = 0.25
RADIUS = 3.0
PRESETS = ("robust", "paper")
BOUNDS = {
    "distance_bound": "bound of that error, weighted",
    "distance_uniform": "bound of that error, largest psi",
    "distance_paper": "bound of that error, the paper's form",
}


def preset(name: str) -> Exaggerate:
    """The settings of a preset of `conf/exaggerate`."""
    return Exaggerate(**OmegaConf.to_container(compose(f"exaggerate={name}").exaggerate))


def sphere_rows(subdivisions: range) -> Iterator[Measurement]:
    """The law S_gamma = R^(-2 gamma) S under refinement; an error's reference is that of the mesh half as fine."""
    coarser = None
    for n in subdivisions:
        mesh = trimesh.creation.icosphere(subdivisions=n, radius=RADIUS)
        vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
        moved = vertices + Exaggerator(vertices, faces, preset("paper")).solve(GAMMA)
        error = float(np.abs(moved - RADIUS ** (-2 * GAMMA) * vertices).max() / RADIUS)
        yield Measurement(f"sphere, {len(vertices)} vertices", "largest error of the sphere law", "1", error, coarser)
        coarser = error


def curvature_rows(refinements: range) -> Iterator[Measurement]:
    """Estimators of K on surfaces with a formula for it: the error's root mean square over the surface, relative.

    The reference is the error at half as many vertices across.
    """
    coarser: dict[tuple[str, str], float] = {}
    for n in refinements:
        for surface, (vertices, faces, truth) in _surfaces(n).items():
            areas = mixed_voronoi_areas(vertices, faces)
            for name, estimate in _estimates(vertices, faces, areas).items():
                error = np.sqrt(np.average((estimate - truth) ** 2, weights=areas))
                error = float(error / np.sqrt(np.average(truth**2, weights=areas)))
                case = f"{surface}, {len(vertices)} vertices"
                yield Measurement(case, f"error of K: {name}", "1", error, coarser.get((surface, name)))
                coarser[surface, name] = error


def _surfaces(n: int) -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Vertices, faces and true K at refinement n."""
    ball = trimesh.creation.icosphere(subdivisions=n)
    axes = np.array([1.0, 0.7, 1.4])
    points = np.asarray(ball.vertices) * axes
    # K = 1 / (a b c sum (x/a^2)^2)^2
    ellipsoid = 1 / (axes.prod() ** 2 * ((points / axes**2) ** 2).sum(axis=1) ** 2)
    around, across = 16 * 2 ** (n - 1), 8 * 2 ** (n - 1)
    ring = trimesh.creation.torus(1.0, 0.4, major_sections=around, minor_sections=across)
    faces, angles = np.asarray(ring.faces), _torus_angles(np.asarray(ring.vertices))
    noise = np.random.default_rng(0).uniform(-0.2, 0.2, angles.shape) * 2 * np.pi / np.array([around, across])
    tori = {"torus": angles, "torus shaken by 20 % of an edge": angles + noise}
    return {
        "ellipsoid": (points, np.asarray(ball.faces), ellipsoid),
        **{name: (_torus(a), faces, np.cos(a[:, 1]) / (0.4 * (1 + 0.4 * np.cos(a[:, 1])))) for name, a in tori.items()},
    }


def _torus_angles(points: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "v 2"]:
    x, y, z = points.T
    return np.stack([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y) - 1.0)], axis=1)


def _torus(angles: Float[np.ndarray, "v 2"]) -> Float[np.ndarray, "v 3"]:
    u, v = angles.T
    reach = 1 + 0.4 * np.cos(v)
    return np.stack([reach * np.cos(u), reach * np.sin(u), 0.4 * np.sin(v)], axis=1)


def _estimates(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], areas: Float[np.ndarray, " v"]
) -> dict[str, Float[np.ndarray, " v"]]:
    defects = angle_defects(vertices, faces, boundary_vertices(faces, len(vertices)))
    thirds = np.bincount(faces.ravel(), np.repeat(igl.doublearea(vertices, faces) / 6, 3), len(vertices))
    stiffness = CotanLaplacian(vertices, faces).stiffness()
    estimates = {"angle defect, mixed Voronoi": defects / areas, "angle defect, barycentric": defects / thirds}
    for share in (0.005, 0.02):
        smooth = diffuse_heat(defects / areas, areas, stiffness, (share * size(vertices, faces)) ** 2)
        estimates[f"the first, heat {100 * share:g} %"] = smooth
    _, _, highest, lowest, *_ = igl.principal_curvature(vertices, faces)
    return {**estimates, "quadric fit (libigl)": highest * lowest}


def path_rows(case: str, solver: Exaggerator) -> Iterator[Measurement]:
    """Paths of 2 (the paper's blend) to 8 Lobatto nodes against exact solves; references are the blend's."""
    levels, extent = np.linspace(0, GAMMA, 26), diagonal(solver.vertices)
    exact = solver.solve_many(levels)
    blend = None
    for count in (2, 3, 4, 5, 6, 8):
        nodes = GAMMA * (1 - np.cos(np.pi * np.arange(count) / (count - 1))) / 2
        path = GammaPath(nodes, solver.solve_many(nodes).astype(np.float32), solver.faces, solver.vertices)
        error = max(
            float(np.linalg.norm(path.displacement(float(level)) - solved, axis=1).max() / extent)
            for level, solved in zip(levels, exact, strict=True)
        )
        query = seconds(lambda path=path: path.displacement(0.1), 200)
        yield Measurement(case, f"largest error of a path of {count} nodes", "diagonal", error, blend and blend[0])
        yield Measurement(case, f"one level of a path of {count} nodes", "s", query, blend and blend[1])
        blend = blend or (error, query)


def bound_rows(case: str, solver: Exaggerator, samples: int = 25) -> Iterator[Measurement]:
    """The linear blend's error over the level, and its bounds; the reference of a bound is the error itself."""
    extent = diagonal(solver.vertices)
    for bound in blend_bounds(solver, GAMMA, np.linspace(0, GAMMA, samples)[1:-1]):
        at = f"at level {bound.level:.4f}"
        yield Measurement(case, f"strain of the blend's error {at}", "1", bound.energy)
        yield Measurement(case, f"bound of that strain, weighted {at}", "1", bound.energy_bound, bound.energy)
        truth = bound.distance / extent
        yield Measurement(case, f"rms error of the blend {at}", "diagonal", truth)
        for name, quantity in BOUNDS.items():
            yield Measurement(case, f"{quantity} {at}", "diagonal", getattr(bound, name) / extent, truth)


def random_person(model: HeadModel, seed: int) -> Float[np.ndarray, "v 3"]:
    """A neutral head whose first 30 identity codes are from N(0, 1), as the model's directions are scaled for."""
    return neutral(model, HeadParameters(shape=np.pad(np.random.default_rng(seed).normal(size=30), (0, 270))))


def lid_rows(
    model: HeadModel, people: int, presets: Sequence[str] = PRESETS, transports: Sequence[str] = tuple(TRANSFER_FACTORS)
) -> Iterator[Measurement]:
    """How far lids close under a full blink at GAMMA, for random people; the reference is the natural closure.

    Closure is the share by which the gap between the lids' landmarks shrinks.
    """
    upper, lower = model.landmarks68[[37, 38, 43, 44]], model.landmarks68[[41, 40, 47, 46]]
    columns = [model.expression_names.index(name) for name in ("eyeBlink_L", "eyeBlink_R")]
    blinks = model.shapedirs[:, :, 300:][:, :, columns].transpose(2, 0, 1).astype(np.float64)

    def gap(vertices: np.ndarray) -> float:
        return float((vertices[upper] - vertices[lower])[:, 1].mean())

    chosen = {name: preset(name) for name in presets}
    for seed in range(1, people + 1):
        head = random_person(model, seed)
        natural = 1 - gap(head + blinks.sum(axis=0)) / gap(head)
        for name, settings in chosen.items():
            solver = Exaggerator(head, model.faces, settings)
            path = solver.path(GAMMA)
            for transport in transports:
                solver.settings = replace(solver.settings, blendshape_transfer=transport)
                caricature = transfer_blendshapes(path, solver, blinks, np.arange(2)).at(GAMMA)
                moved = head + caricature.displacement
                closed = 1 - gap(moved + blinks.sum(axis=0) + caricature.blendshape_change(np.ones(2))) / gap(moved)
                case = f"person {seed}, {name}"
                yield Measurement(case, f"lids closed by a blink, {transport}", "gap", closed, natural)
