"""Errors of the exaggeration: curvature, the sphere law, paths, bounds of the blend error, closure of lids."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import trimesh
from jaxtyping import Float
from omegaconf import OmegaConf

from carigs.config import compose
from carigs.exaggeration import Exaggerator, GammaPath, transfer_blendshapes
from carigs.exaggeration.blend_bound import blend_bounds
from carigs.exaggeration.blendshape_transfer import TRANSFER_FACTORS
from carigs.head import HeadModel, HeadParameters, neutral
from carigs.mesh.triangle_mesh import diagonal
from carigs.settings import Exaggerate
from evaluation.benchmarks.measurement.timing import Measurement, median_time

GAMMA = 0.25
RADIUS = 3.0
PRESETS = ("robust", "paper")
BOUNDS = {
    "distance_bound": "bound of that error, weighted",
    "distance_uniform": "bound of that error, largest psi",
    "distance_paper": "bound of that error, the paper's form",
}


def preset(name: str) -> Exaggerate:
    """Settings of a preset of `conf/exaggerate`.

    Args:
        name: Name of the preset.

    Returns:
        The settings.
    """
    return Exaggerate(**OmegaConf.to_container(compose(f"exaggerate={name}").exaggerate))


def measure_sphere_law(subdivisions: range) -> Iterator[Measurement]:
    """Measure the error of the sphere law S_gamma = R^(-2 gamma) S, exact for a sphere of radius R, under refinement.

    Args:
        subdivisions: Finenesses of the icosphere.

    Yields:
        Errors; the reference is the error of the previous mesh.
    """
    coarser = None
    for n in subdivisions:
        mesh = trimesh.creation.icosphere(subdivisions=n, radius=RADIUS)
        vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
        moved = vertices + Exaggerator(vertices, faces, preset("paper")).solve(GAMMA)
        error = float(np.abs(moved - RADIUS ** (-2 * GAMMA) * vertices).max() / RADIUS)
        yield Measurement(f"sphere, {len(vertices)} vertices", "largest error of the sphere law", "1", error, coarser)
        coarser = error


def measure_paths(case: str, solver: Exaggerator) -> Iterator[Measurement]:
    """Measure the error of paths of 2 to 8 Lobatto nodes against exact solutions, and their times.

    Args:
        case: Name of the head.
        solver: Its solver.

    Yields:
        Records; references are those of two nodes, the paper's linear blend. Last the nodes of the default path.
    """
    levels, extent = np.linspace(0, GAMMA, 26), diagonal(solver.vertices)
    exact = solver.solve_many(levels)
    blend = None
    for count in (2, 3, 4, 5, 6, 8):
        nodes = GAMMA * (1 - np.cos(np.pi * np.arange(count) / (count - 1))) / 2
        path = GammaPath(nodes, solver.solve_many(nodes).astype(np.float32), solver.faces, solver.vertices)
        error = path_error(path, levels, exact) / extent
        query = median_time(lambda path=path: path.displacement(0.1), 200)
        solve = median_time(lambda nodes=nodes: solver.solve_many(nodes), 3, time.process_time)
        yield Measurement(case, f"largest error of a path of {count} nodes", "diagonal", error, blend and blend[0])
        yield Measurement(case, f"one level of a path of {count} nodes", "s", query, blend and blend[1])
        yield Measurement(case, f"CPU: solve a path of {count} nodes", "s", solve, blend and blend[2])
        blend = blend or (error, query, solve)
    yield Measurement(case, "nodes of the default path", "1", len(solver.path(GAMMA).levels))


def path_error(path: GammaPath, levels: Float[np.ndarray, " n"], exact: Float[np.ndarray, "n v 3"]) -> float:
    """Largest distance of a path from exact solutions.

    Args:
        path: The path.
        levels: Levels to compare.
        exact: Displacement that the solver gives at each level.

    Returns:
        Distance in metres.
    """
    distances = (path.displacement(float(level)) - solved for level, solved in zip(levels, exact, strict=True))
    return max(float(np.linalg.norm(distance, axis=1).max()) for distance in distances)


def measure_blend_bounds(case: str, solver: Exaggerator, samples: int = 25) -> Iterator[Measurement]:
    """Measure the error of the linear blend over the level, and its bounds (equations 8 and 9 of the paper).

    Args:
        case: Name of the head.
        solver: Its solver.
        samples: Number of levels, ends included.

    Yields:
        Records; the reference of a bound is the error itself.
    """
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
    """Neutral head of a random person: the first 30 identity coefficients are drawn from N(0, 1).

    Args:
        model: Head model.
        seed: Seed of the coefficients.

    Returns:
        Vertices in metres.
    """
    shape = np.pad(np.random.default_rng(seed).normal(size=30), (0, model.num_identity - 30))
    return neutral(model, replace(HeadParameters.zeros(model), shape=shape))


def full_blink(model: HeadModel) -> Float[np.ndarray, "2 v 3"]:
    """Blendshapes that close both eyes.

    Args:
        model: Head model with the blendshapes eyeBlink_L and eyeBlink_R.

    Returns:
        Displacements in metres.
    """
    columns = [model.expression_names.index(name) for name in ("eyeBlink_L", "eyeBlink_R")]
    return model.expression_basis[:, :, columns].transpose(2, 0, 1).astype(np.float64)


def blink_by_transfer(
    head: Float[np.ndarray, "v 3"],
    model: HeadModel,
    settings: Exaggerate,
    transfers: Sequence[str] = tuple(TRANSFER_FACTORS),
) -> Iterator[tuple[str, Float[np.ndarray, "v 3"], Float[np.ndarray, "v 3"]]]:
    """Caricature of a head with each blendshape transfer.

    Args:
        head: Vertices of the neutral head in metres.
        model: Its head model.
        settings: Settings of the exaggeration.
        transfers: Values of `exaggerate.blendshape_transfer`.

    Yields:
        Name of the transfer, and the caricature with open and with closed eyes.
    """
    blinks, solver = full_blink(model), Exaggerator(head, model.faces, settings)
    path = solver.path(GAMMA)
    for transfer in transfers:
        solver.settings = replace(solver.settings, blendshape_transfer=transfer)
        caricature = transfer_blendshapes(path, solver, blinks, np.arange(2)).at(GAMMA)
        moved = head + caricature.displacement
        yield transfer, moved, moved + blinks.sum(axis=0) + caricature.blendshape_change(np.ones(2))


def measure_lid_closure(
    model: HeadModel, people: int, presets: Sequence[str] = PRESETS, transfers: Sequence[str] = tuple(TRANSFER_FACTORS)
) -> Iterator[Measurement]:
    """Measure how far the lids of random people close under a full blink at `GAMMA`.

    Closure is the share by which the gap between the landmarks of the lids shrinks.

    Args:
        model: Head model with landmarks and eyeBlink.
        people: Number of people.
        presets: Presets of the exaggeration.
        transfers: Values of `exaggerate.blendshape_transfer`.

    Yields:
        Closures; the reference is that of the natural head.
    """
    upper, lower = model.landmarks68[[37, 38, 43, 44]], model.landmarks68[[41, 40, 47, 46]]
    blink = full_blink(model).sum(axis=0)

    def gap(vertices: np.ndarray) -> float:
        return float((upper.interpolate(vertices) - lower.interpolate(vertices))[:, 1].mean())

    for seed in range(1, people + 1):
        head = random_person(model, seed)
        natural = 1 - gap(head + blink) / gap(head)
        for name in presets:
            for transfer, opened, closed in blink_by_transfer(head, model, preset(name), transfers):
                case, closure = f"person {seed}, {name}", 1 - gap(closed) / gap(opened)
                yield Measurement(case, f"lids closed by a blink, {transfer}", "gap", closure, natural)
