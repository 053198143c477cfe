"""Time against error of the exaggeration: on spheres, where the answer is known, and on heads.

python -m evaluation.benchmarks.surface results/benchmark/surface.csv head.obj ...
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float, Int

from carigs.errors import InputError
from carigs.settings import Exaggerate
from carigs.surface import Exaggerator
from carigs.surface.bound import blend_bounds
from carigs.surface.mesh import diagonal
from carigs.surface.occlusion import ambient_occlusion
from evaluation.benchmarks.measurements import Measurement, seconds, write_measurements

GAMMA = 0.25
RADIUS = 3.0
RAW = Exaggerate(
    curvature_floor=1e-9, relative_curvature=False, heat=0.0, limit_cavities=False, normalise=False, followers=False
)


def sphere_rows(subdivisions: range, repeats: int = 5) -> Iterator[Measurement]:
    """The law S_gamma = R^(-2 gamma) S under refinement; an error's reference is that of the mesh half as fine."""
    coarser = None
    for n in subdivisions:
        mesh = trimesh.creation.icosphere(subdivisions=n, radius=RADIUS)
        vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
        moved = vertices + Exaggerator(vertices, faces, RAW).solve(GAMMA)
        error = float(np.abs(moved - RADIUS ** (-2 * GAMMA) * vertices).max() / RADIUS)
        case = f"sphere, {len(vertices)} vertices"
        yield Measurement(case, "largest error of the sphere law", "radius", error, coarser)
        yield from time_rows(case, vertices, faces, RAW, repeats)
        coarser = error


def head_rows(
    case: str, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], repeats: int = 5
) -> Iterator[Measurement]:
    """What a head costs; how far paths of 2 (the paper's blend) to 5 nodes are from exact solves; the bounds."""
    occlusion = seconds(lambda: ambient_occlusion(vertices, faces), 1)
    yield Measurement(case, "ambient occlusion", "s", occlusion)
    yield from time_rows(case, vertices, faces, Exaggerate(limit_cavities=False), repeats)

    solver = Exaggerator(vertices, faces)
    levels, size = np.linspace(0, GAMMA, 26), diagonal(vertices)
    exact = solver.solve_many(levels)
    blend = None
    for k in (2, 3, 4, 5):
        solver.settings = replace(solver.settings, nodes=tuple((1 - np.cos(np.pi * np.arange(k) / (k - 1))) / 2))
        path = solver.path(GAMMA)
        error = max(
            float(np.linalg.norm(path.displacement(float(level)) - solved, axis=1).max() / size)
            for level, solved in zip(levels, exact, strict=True)
        )
        yield Measurement(case, f"largest error of a path of {k} nodes", "diagonal", error, blend)
        yield Measurement(case, f"one level of a path of {k} nodes", "s", seconds(lambda p=path: p.displacement(0.1)))
        blend = error if blend is None else blend

    worst = max(blend_bounds(solver, GAMMA, levels[1:-1]), key=lambda bound: bound.distance)
    yield Measurement(case, "bound of the blend's strain", "1", worst.energy_bound, worst.energy)
    for name in ("distance_bound", "distance_uniform", "distance_paper"):
        value, truth = getattr(worst, name) / size, worst.distance / size
        yield Measurement(case, f"bound of the blend's rms error: {name}", "diagonal", value, truth)


def time_rows(
    case: str, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], settings: Exaggerate, repeats: int
) -> Iterator[Measurement]:
    """Set-up and one level; the reference of a level is the time without the factors of the set-up."""
    setup = seconds(lambda: Exaggerator(vertices, faces, settings), repeats)
    solver = Exaggerator(vertices, faces, settings)
    level = seconds(lambda: solver.solve(GAMMA), repeats)
    yield Measurement(case, "set-up without occlusion", "s", setup)
    yield Measurement(case, "one exact level", "s", level, setup + level)


def benchmark(file: Path, meshes: list[Path]) -> None:
    """Measure the spheres and the given heads, and write `file`."""
    for mesh in meshes:
        if not mesh.is_file():
            raise InputError("no such mesh", file=mesh)
    rows = list(sphere_rows(range(2, 7)))
    for mesh in meshes:
        head = trimesh.load(mesh, process=False, maintain_order=True, force="mesh")
        rows += head_rows(mesh.stem, np.asarray(head.vertices, np.float64), np.asarray(head.faces))
    write_measurements(file, rows)


if __name__ == "__main__":
    benchmark(Path(sys.argv[1]), [Path(mesh) for mesh in sys.argv[2:]])
