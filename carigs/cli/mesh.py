"""`carigs mesh`: exaggerate a mesh file.

The mesh is repaired first and the repairs are printed. The result has the vertices of the file, in their order. From
.obj to .obj and from .ply to .ply everything else is kept too: polygons, texture coordinates, references to materials.
Units do not matter. In the preview +y is up and the face looks along +z.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float

from carigs.capture.evenly_spread import evenly_spread
from carigs.cli.options.parser import command_parser, region_level
from carigs.config import compose, known
from carigs.errors import InputError, MeshError, SettingsError
from carigs.exaggeration.exaggerator import Exaggerator
from carigs.mesh.deformation import check_deformation
from carigs.mesh.mesh_file import moved_mesh_file
from carigs.mesh.regions import find_region, vertex_field
from carigs.mesh.repair import CleanMesh, clean_mesh
from carigs.mesh.self_intersection import self_intersecting_faces
from carigs.readers.arrays import checked_array
from carigs.readers.json_files import read_json
from carigs.readers.mesh_files.meshes import FORMATS, read_mesh
from carigs.readers.npz import read_npz
from carigs.readers.pickles import read_pickle
from carigs.settings import DEFAULT_GAMMA, USEFUL_LEVEL, Exaggerate
from carigs.system.files import writing
from evaluation.figures.clay import clay_sheet

WRITTEN = tuple(suffix for suffix in FORMATS if suffix != ".gltf")  # which may be several files
EXAMPLES = """examples:
  carigs mesh head.obj -o caricature.ply
  carigs mesh head.obj --gamma 0.3 --levels 6 -o steps.obj        six files, from 0.05 to 0.3
  carigs mesh head.obj --regions FLAME_masks.pkl --region nose=0.4 --region ears=0 -o nose.ply
  carigs mesh head.obj --gamma 0 --regions masks.json --region nose=0.4 -o nose.ply

With --gamma 0 only the regions are exaggerated and the rest is held. A negative level reduces what is characteristic.
Useful levels end at about 0.5: beyond, the surface folds and cuts itself, and a warning says so. Levels outside [-1, 1]
are refused without --force.
"""

MAX_LEVEL = 100.0
MAX_LEVELS = 100
PREVIEW_ROWS = 10


def read_regions(file: Path) -> dict[str, np.ndarray]:
    """Read the regions of a mesh.

    Args:
        file: `.json`, `.npz`, `FLAME_masks.pkl`, or a head model's file.

    Returns:
        By name a list of vertices, a mask or a scalar per vertex.

    Raises:
        InputError: For a missing or broken file.
    """
    read = {".pkl": read_pickle, ".npz": read_npz, ".json": partial(read_json, kind=dict)}.get(file.suffix)
    if read is None:
        raise InputError("not a file of regions: .json, .npz or FLAME_masks.pkl", file=file)
    arrays = read(file)
    masks = {name.removeprefix("mask_"): array for name, array in arrays.items() if name.startswith("mask_")}
    return {name: checked_array(masks or arrays, name, file=file) for name in masks or arrays}


def exaggerate(task: argparse.Namespace) -> None:
    """Repair and solve a mesh; write the caricature (with several levels one file each) and, if named, a preview.

    Nothing is written before all levels are solved and checked.

    Args:
        task: The command line, with a level for each name in `region_levels`.

    Raises:
        InputError: For unusable files and folders.
        MeshError: If the mesh cannot be solved on, or moves absurdly far.
        SettingsError: For levels out of range, or regions without a file that names them.
    """
    started = time.perf_counter()

    def report(text: str) -> None:
        print(f"{time.perf_counter() - started:6.2f} s  {text}", flush=True)

    if task.region_levels and task.regions is None:
        raise SettingsError(f"--region {next(iter(task.region_levels))}: give the names of regions with --regions FILE")
    for name, level in {"gamma": task.gamma, **task.region_levels}.items():
        if not abs(level) <= MAX_LEVEL:
            raise SettingsError(f"{name}={level:g}: levels lie in [-{MAX_LEVEL:g}, {MAX_LEVEL:g}]")
        if not (task.force or abs(level) <= USEFUL_LEVEL):
            useful = f"levels outside [-{USEFUL_LEVEL:g}, {USEFUL_LEVEL:g}] tear the surface"
            raise SettingsError(f"{name}={level:g}: {useful}; --force solves for them all the same")
    fractions = (1 + np.arange(task.levels)) / task.levels
    outputs = level_files(task.output, fractions * (task.gamma or next(iter(task.region_levels.values()), 0.0)))
    check_outputs(outputs, task.preview, [file for file in (task.mesh, task.regions) if file])
    mesh = read_mesh(task.mesh)
    try:
        clean = clean_mesh(mesh.vertices, mesh.faces)
    except MeshError as error:
        raise InputError(str(error), file=task.mesh) from error
    report(str(clean.report))
    settings = Exaggerate(**compose(f"exaggerate={task.preset}").exaggerate)
    fields = {name: _region_field(clean, task.regions, name) for name in task.region_levels}
    try:
        exaggerator = Exaggerator(clean.vertices, clean.faces, settings, regions=fields)
    except MeshError as error:
        raise InputError(str(error), file=task.mesh) from error
    report("factorised")
    cut_before, displacements = self_intersecting_faces(clean.vertices, clean.faces), {}
    for fraction in fractions:
        region_levels = {name: fraction * level for name, level in task.region_levels.items()}
        label = "level " + ", ".join(f"{level:.3g}" for level in (fraction * task.gamma, *region_levels.values()))
        if task.gamma == 0:
            local = (exaggerator.local_edit(region).solve(level) for region, level in region_levels.items())
            displacement = sum(local, 0 * clean.vertices)
        else:
            displacement = exaggerator.solve(fraction * task.gamma, region_levels)
        check_deformation(clean.vertices, displacement, clean.faces, label, cut_before)
        displacements[fraction] = label, displacement
    for file, (_, displacement) in zip(outputs, displacements.values(), strict=True):
        moved = np.asarray(mesh.vertices) + clean.to_input(displacement)
        content = moved_mesh_file(task.mesh, moved, np.asarray(mesh.faces), file)
        with _typed_write_errors(file), writing(file) as part:
            part.write_bytes(content)
        report(f"{file}: moved by up to {np.linalg.norm(displacement, axis=1).max():.4g}")
    if task.preview is None:
        return
    shown = [displacements[fraction] for fraction in evenly_spread(fractions, PREVIEW_ROWS)]
    previewed = {"level 0": clean.vertices} | {label: clean.vertices + moved for label, moved in shown}
    with _typed_write_errors(task.preview):
        clay_sheet(task.preview, previewed, clean.faces)
    report(str(task.preview))


def level_files(output: Path, levels: np.ndarray) -> list[Path]:
    """Name a file for each level.

    Args:
        output: The name for one level; of several, each level is appended to its stem.
        levels: The levels.

    Returns:
        A file for each level.

    Raises:
        SettingsError: If two levels are equal.
    """
    if len(levels) == 1:
        return [output]
    for digits in range(3, 18):
        names = [f"{level:.{digits}g}" for level in levels]
        if len(set(names)) == len(names):
            return [output.with_stem(f"{output.stem}_{name}") for name in names]
    raise SettingsError(f"--levels {len(levels)}: the levels must differ, found {levels[0]:g}, {levels[1]:g}, ...")


def check_outputs(meshes: Sequence[Path], preview: Path | None, inputs: Sequence[Path]) -> None:
    """Refuse outputs that cannot be written, or that would replace an input.

    Args:
        meshes: Mesh files.
        preview: The picture, if there is to be one.
        inputs: Files that are read. Links, other spellings and other cases of their names are recognised.

    Raises:
        InputError: If an output has an unknown suffix, its folder is missing, it exists and is not a regular file, or
            it is one of the inputs.
    """
    if meshes[0].suffix.lower() not in WRITTEN:
        raise InputError(f"unknown kind of mesh; known: {' '.join(WRITTEN)}", file=meshes[0])
    if preview and preview.suffix.lower() != ".png":
        raise InputError("the preview is a .png", file=preview)
    for file in (*meshes, *([preview] if preview else [])):
        try:
            if not file.parent.is_dir():
                raise InputError("no such folder", file=file.parent)
            if not file.exists():
                continue
            if not file.is_file():
                raise InputError("exists and is not a regular file", file=file)
            for source in inputs:
                if source.exists() and file.samefile(source):
                    raise InputError(f"is the input {source}; write to another file", file=file)
        except OSError as error:
            raise InputError(f"cannot be written ({error.strerror})", file=file) from error


@contextmanager
def _typed_write_errors(file: Path) -> Iterator[None]:
    """Turn the errors of a full disk or a protected folder into `InputError`."""
    try:
        yield
    except (OSError, ValueError) as error:  # ValueError: a NUL character in the path
        raise InputError(f"cannot be written ({getattr(error, 'strerror', None) or error})", file=file) from error


def _region_field(clean: CleanMesh, file: Path, name: str) -> Float[np.ndarray, " v"]:
    """The region as a scalar on the repaired mesh."""
    region = find_region(read_regions(file), name)
    try:
        return clean.from_input(vertex_field(region, len(clean.vertex_map)))
    except SettingsError as error:
        raise InputError(str(error), file=file, field=name) from error


def main(arguments: list[str]) -> int:
    """Run the subcommand.

    Args:
        arguments: Its command line.

    Returns:
        Exit code.
    """
    parser = command_parser("mesh", __doc__, EXAMPLES)
    parser.add_argument("mesh", type=Path, help=f"the neutral head: {' '.join(FORMATS)}")
    parser.add_argument(
        "--gamma", type=float, default=DEFAULT_GAMMA, help="level; 0 is the mesh itself (default %(default)s)"
    )
    region = {"type": region_level, "action": "append", "default": [], "metavar": "NAME=LEVEL"}
    parser.add_argument("--region", dest="region_levels", help="level of a region", **region)
    parser.add_argument(
        "--regions", type=Path, metavar="FILE", help="names of regions: FLAME_masks.pkl, a head model, .npz or .json"
    )
    parser.add_argument("--levels", type=int, default=1, help="files at equal steps up to gamma (default %(default)s)")
    parser.add_argument("--preset", choices=known("exaggerate"), default="robust", help="(default %(default)s)")
    parser.add_argument("-o", "--output", type=Path, required=True, help="mesh to write")
    picture = parser.add_mutually_exclusive_group()
    picture.add_argument("--preview", type=Path, help="PNG to write (default: OUTPUT_preview.png)")
    picture.add_argument("--no-picture", action="store_true", help="write no PNG, which takes a third of the time")
    parser.add_argument("--force", action="store_true", help="allow levels outside [-1, 1]")
    task = parser.parse_args(arguments)
    if not np.isfinite(task.gamma):
        parser.error(f"--gamma {task.gamma}: expected a number")
    if not 1 <= task.levels <= MAX_LEVELS:
        parser.error(f"--levels {task.levels}: expected 1 to {MAX_LEVELS}")
    task.region_levels = dict(task.region_levels)
    if not task.no_picture:
        task.preview = task.preview or task.output.with_name(f"{task.output.stem}_preview.png")
    exaggerate(task)
    return 0
