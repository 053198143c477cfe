"""Time against error of the exaggeration: on surfaces where the answer is known, and on heads.

python -m evaluation.benchmarks.surface results/benchmark/surface.csv head.obj ... --head-model ict_model.npz
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float, Int

from carigs.errors import InputError
from carigs.exaggeration import Exaggerator
from carigs.head import HeadModel
from carigs.mesh import clean_mesh
from carigs.mesh.ambient_occlusion import ambient_occlusion
from carigs.settings import Exaggerate
from evaluation.benchmarks.measurements import Measurement, seconds, write_measurements
from evaluation.benchmarks.surface_accuracy import (
    GAMMA,
    PRESETS,
    bound_rows,
    curvature_rows,
    lid_rows,
    path_rows,
    preset,
    sphere_rows,
)
from evaluation.benchmarks.surface_chart import plot
from evaluation.benchmarks.surface_solvers import order_rows, size_rows

FLAME_SIZE = 5023
PEOPLE = 20

Mesh = tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]


def time_rows(case: str, mesh: Mesh, settings: Exaggerate, repeats: int = 5) -> Iterator[Measurement]:
    """CPU seconds from arrays to one level; the reference of a level is the sum of all."""

    def spent(work: Callable[[], object]) -> float:
        return seconds(work, repeats, time.process_time)

    door = spent(lambda: clean_mesh(*mesh))
    setup = spent(lambda: Exaggerator(*mesh, settings))
    solver = Exaggerator(*mesh, settings)
    level = spent(lambda: solver.solve(GAMMA))
    yield Measurement(case, "CPU: check and mend", "s", door)
    yield Measurement(case, "CPU: set-up without occlusion", "s", setup)
    yield Measurement(case, "CPU: one exact level", "s", level, door + setup + level)


def head_rows(case: str, mesh: Mesh) -> Iterator[Measurement]:
    """What a head costs, and how far paths are from exact solves."""
    occlusion = seconds(lambda: ambient_occlusion(*mesh), 1, time.process_time, warm=False)
    yield Measurement(case, "CPU: ambient occlusion", "s", occlusion)
    yield from time_rows(case, mesh, Exaggerate(limit_cavities=False))
    solver = Exaggerator(*mesh, preset("robust"))
    yield from order_rows(case, solver)
    yield from path_rows(case, solver)


def measurements(heads: Mapping[str, Mesh], typical: str, model: HeadModel | None) -> Iterator[Measurement]:
    """All rows, what takes longest last."""
    yield from sphere_rows(range(2, 7))
    yield from curvature_rows(range(2, 6))
    for name, mesh in heads.items():
        yield from head_rows(name, mesh)
    for name in PRESETS:
        yield from bound_rows(f"{typical}, {name}", Exaggerator(*heads[typical], preset(name)))
    yield from size_rows(*heads[typical])
    if model is not None:
        yield from lid_rows(model, PEOPLE)


def told(rows: Iterable[Measurement]) -> Iterator[Measurement]:
    """The rows, and a line for each new case."""
    start, case = time.perf_counter(), None
    for row in rows:
        if row.case != case:
            case = row.case
            print(f"{time.perf_counter() - start:6.1f} s  {case}", flush=True)
        yield row


def benchmark(file: Path, heads: Mapping[str, Mesh], model: HeadModel | None) -> None:
    """Measure, and write `file` and the plot beside it; without heads, a torus of a head's size takes their place."""
    torus = trimesh.creation.torus(1.0, 0.4, major_sections=100, minor_sections=50)
    shown = dict(heads) or {"torus": (np.asarray(torus.vertices), np.asarray(torus.faces))}
    typical = min(shown, key=lambda name: abs(len(shown[name][0]) - FLAME_SIZE))
    rows = write_measurements(file, told(measurements(shown, typical, model)))
    plot(file.with_suffix(".png"), rows, typical)


def main() -> None:
    """Read the heads, all before any work starts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rows", type=Path, help="CSV to write; its plot goes beside it")
    parser.add_argument("meshes", type=Path, nargs="*", help="heads")
    parser.add_argument("--head-model", type=Path, help="for how lids close: a model with landmarks and eyeBlink")
    given = parser.parse_args()
    model = HeadModel.load(given.head_model) if given.head_model else None
    benchmark(given.rows, read_heads(given.meshes), model)


def read_heads(files: list[Path]) -> dict[str, Mesh]:
    """Meshes by name; raises `InputError` for a missing one."""
    for file in files:
        if not file.is_file():
            raise InputError("no such mesh", file=file)
    loaded = {file.stem: trimesh.load(file, process=False, maintain_order=True, force="mesh") for file in files}
    return {name: (np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces)) for name, mesh in loaded.items()}


if __name__ == "__main__":
    main()
