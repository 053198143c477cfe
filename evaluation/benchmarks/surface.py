"""Time and error of the exaggeration, on surfaces with a known solution and on heads; time to pose a head.

Example:
    python -m evaluation.benchmarks.surface results/benchmark/surface.csv head.obj ... --head-model ict_model.npz
"""

from __future__ import annotations

import time
from argparse import ArgumentParser, Namespace
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float, Int

from carigs.exaggeration import Exaggerator
from carigs.head import HeadModel
from carigs.mesh import clean_mesh
from carigs.mesh.ambient_occlusion import ambient_occlusion
from carigs.readers.mesh_files.meshes import read_mesh
from carigs.settings import Exaggerate
from evaluation.benchmarks.exaggeration import surface_accuracy as accuracy
from evaluation.benchmarks.exaggeration.curvature_accuracy import measure_curvature
from evaluation.benchmarks.exaggeration.surface_solvers import measure_fill_in, measure_solvers
from evaluation.benchmarks.measurement.plots import plot_surface
from evaluation.benchmarks.measurement.timing import Measurement, elapsed, median_time, write_measurements
from evaluation.benchmarks.posing import measure_posing
from evaluation.command_line import csv_parser, run

FLAME_SIZE = 5023
PEOPLE = 20

Mesh = tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]


def measure_set_up(case: str, mesh: Mesh, settings: Exaggerate, repeats: int = 5) -> Iterator[Measurement]:
    """Measure the CPU time from arrays to one level.

    Args:
        case: Name of the head.
        mesh: The head.
        settings: Settings of the exaggeration.
        repeats: Number of timed calls.

    Yields:
        Records; the reference of a level is the sum of all steps.
    """
    cpu = partial(median_time, repeats=repeats, clock=time.process_time)
    repair = cpu(lambda: clean_mesh(*mesh))
    setup = cpu(lambda: Exaggerator(*mesh, settings))
    solver = Exaggerator(*mesh, settings)
    level = cpu(lambda: solver.solve(accuracy.GAMMA))
    yield Measurement(case, "CPU: check and mend", "s", repair)
    yield Measurement(case, "CPU: set-up without occlusion", "s", setup)
    yield Measurement(case, "CPU: one exact level", "s", level, repair + setup + level)


def measure_head(case: str, mesh: Mesh) -> Iterator[Measurement]:
    """Measure the times of a head, and the error of its paths against exact solutions.

    Args:
        case: Name of the head.
        mesh: The head.

    Yields:
        Records.
    """
    occlusion = elapsed(lambda: ambient_occlusion(*mesh), time.process_time)
    yield Measurement(case, "CPU: ambient occlusion", "s", occlusion)
    yield from measure_set_up(case, mesh, Exaggerate(limit_cavities=False))
    solver = Exaggerator(*mesh, accuracy.preset("robust"))
    yield from measure_fill_in(case, solver)
    yield from accuracy.measure_paths(case, solver)


def measurements(heads: Mapping[str, Mesh], typical: str, model: HeadModel | None) -> Iterator[Measurement]:
    """Take all measurements, the slowest last.

    Args:
        heads: Heads by name.
        typical: Name of the head whose bounds and solvers are measured.
        model: Head model for the closure of lids; None to leave it out.

    Yields:
        Records.
    """
    yield from measure_posing()
    yield from accuracy.measure_sphere_law(range(2, 7))
    yield from measure_curvature(range(2, 6))
    for name, mesh in heads.items():
        yield from measure_head(name, mesh)
    for name in accuracy.PRESETS:
        solver = Exaggerator(*heads[typical], accuracy.preset(name))
        yield from accuracy.measure_blend_bounds(f"{typical}, {name}", solver)
    yield from measure_solvers(*heads[typical])
    if model is not None:
        yield from accuracy.measure_lid_closure(model, PEOPLE)


def benchmark(file: Path, heads: Mapping[str, Mesh], model: HeadModel | None) -> None:
    """Measure, and write the records and their plot.

    Args:
        file: CSV file to write; the plot goes beside it.
        heads: Heads by name; if empty, a torus of a head's size takes their place.
        model: Head model for the closure of lids; None to leave it out.
    """
    torus = trimesh.creation.torus(1.0, 0.4, major_sections=100, minor_sections=50)
    meshes = dict(heads) or {"torus": (np.asarray(torus.vertices), np.asarray(torus.faces))}
    typical = min(meshes, key=lambda name: abs(len(meshes[name][0]) - FLAME_SIZE))
    records = write_measurements(file, measurements(meshes, typical, model))
    plot_surface(file.with_suffix(".png"), records, typical, accuracy.PRESETS)


def main() -> None:
    """Run the benchmark from the command line; all heads are read before work starts."""
    arguments, heads, model = parse_heads(csv_parser(__doc__))
    benchmark(arguments.rows, heads, model)


def parse_heads(parser: ArgumentParser) -> tuple[Namespace, dict[str, Mesh], HeadModel | None]:
    """Parse a command line that names heads and a head model, and read them.

    Args:
        parser: Parser of the other arguments.

    Returns:
        The arguments, the heads by name, and the head model if there is one.
    """
    parser.add_argument("meshes", type=Path, nargs="*", help="heads")
    parser.add_argument("--head-model", type=Path, help="for random people: a model with landmarks and eyeBlink")
    arguments = parser.parse_args()
    model = HeadModel.load(arguments.head_model) if arguments.head_model else None
    return arguments, read_heads(arguments.meshes), model


def read_heads(files: list[Path]) -> dict[str, Mesh]:
    """Read meshes.

    Args:
        files: Mesh files of any format that trimesh reads.

    Returns:
        Vertices and faces, by the name of the file without suffix.

    Raises:
        InputError: A file is missing.
    """
    loaded = {file.stem: read_mesh(file) for file in files}
    return {name: (np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces)) for name, mesh in loaded.items()}


if __name__ == "__main__":
    run(main)
