"""Exaggerate a mesh: python -m carigs.cli.mesh head.obj --gamma 0.25 -o caricature.ply.

The mesh is checked first and what was mended is told; the result has the vertices of the file, in their order.  Units
do not matter; for the preview +y is up and the face looks along +z.

Regions have levels of their own: --regions FLAME_masks.pkl --region nose=0.4 --region ears=0.  With --gamma 0 the
regions alone are exaggerated and the rest is held.  A negative level takes character away.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float

from carigs.config import compose, known
from carigs.errors import CarigsError, InputError, SettingsError
from carigs.exaggeration.exaggerator import Exaggerator
from carigs.head.flame_pickle import read_pickle
from carigs.mesh.regions import find_region, vertex_field
from carigs.mesh.repair import CleanMesh, clean_mesh
from carigs.settings import Exaggerate
from evaluation.figures.clay import clay_sheet

FORMATS = (".obj", ".ply", ".off", ".stl", ".glb")


def read_mesh(file: Path) -> trimesh.Trimesh:
    """The triangles of a file, vertices in its order; several objects become one."""
    if file.suffix.lower() not in FORMATS:
        raise InputError(f"unknown kind of mesh; known: {' '.join(FORMATS)}", file=file)
    if not file.is_file():
        raise InputError("no such file", file=file)
    try:
        mesh = trimesh.load(file, process=False, maintain_order=True, force="mesh")
    except Exception as error:  # trimesh's readers raise whatever their format's parser does
        raise InputError(f"not a readable mesh ({error})", file=file) from error
    if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0:
        raise InputError("holds no triangles", file=file)
    return mesh


def read_regions(file: Path) -> dict[str, np.ndarray]:
    """Vertex lists, masks or painted scalars by name: from .json, .npz, FLAME_masks.pkl, or a head model's file."""
    if not file.is_file():
        raise InputError("no such file", file=file)
    try:
        if file.suffix == ".pkl":
            arrays = read_pickle(file)
        elif file.suffix == ".npz":
            with np.load(file, allow_pickle=False) as archive:
                arrays = {name: archive[name] for name in archive.files}
        else:
            arrays = dict(json.loads(file.read_text(encoding="utf-8")))
        masks = {name.removeprefix("mask_"): array for name, array in arrays.items() if name.startswith("mask_")}
        return {name: np.asarray(array) for name, array in (masks or arrays).items()}
    except (OSError, ValueError, TypeError, EOFError) as error:
        raise InputError(f"not a file of regions: .json, .npz or FLAME_masks.pkl ({error})", file=file) from error


def exaggerate(
    file: Path,
    gamma: float,
    regions: Mapping[str, float],
    names: Path | None,
    levels: int,
    preset: str,
    output: Path,
    picture: Path,
) -> None:
    """Read, check, solve, write `output` (with several levels one file for each) and the picture."""
    started = time.perf_counter()

    def say(text: str) -> None:
        print(f"{time.perf_counter() - started:6.2f} s  {text}", flush=True)

    if output.suffix.lower() not in FORMATS:
        raise InputError(f"unknown kind of mesh; known: {' '.join(FORMATS)}", file=output)
    for written in (output, picture):
        if not written.parent.is_dir():
            raise InputError("no such folder", file=written.parent)
    if regions and names is None:
        raise SettingsError(f"--region {next(iter(regions))}: give the names of regions with --regions FILE")
    mesh = read_mesh(file)
    clean = clean_mesh(mesh.vertices, mesh.faces)
    say(str(clean.report))
    settings = Exaggerate(**compose(f"exaggerate={preset}").exaggerate)
    fields = {name: _field(clean, names, name) for name in regions}
    exaggerator = Exaggerator(clean.vertices, clean.faces, settings, regions=fields)
    say("factorised")
    shown = {"level 0": clean.vertices}
    for share in (1 + np.arange(levels)) / levels:
        own = {name: share * level for name, level in regions.items()}
        name = ", ".join(f"{level:.3g}" for level in (share * gamma, *own.values()))
        if gamma == 0:
            displacement = sum((exaggerator.local_edit(n).solve(level) for n, level in own.items()), 0 * clean.vertices)
        else:
            displacement = exaggerator.solve(share * gamma, own)
        result = mesh.copy()
        result.vertices = np.asarray(mesh.vertices) + clean.to_input(displacement)
        target = output if levels == 1 else output.with_stem(f"{output.stem}_{_step(share, gamma, own)}")
        result.export(target)
        shown[f"level {name}"] = clean.vertices + displacement
        say(f"{target}: moved by up to {np.linalg.norm(displacement, axis=1).max():.4g}")
    clay_sheet(picture, shown, clean.faces)
    say(str(picture))


def _field(clean: CleanMesh, file: Path, name: str) -> Float[np.ndarray, " v"]:
    """The region on the mesh as it was cleaned."""
    region = find_region(read_regions(file), name)
    try:
        return clean.from_input(vertex_field(region, len(clean.vertex_map)))
    except SettingsError as error:
        raise InputError(str(error), file=file, field=name) from error


def _step(share: float, gamma: float, own: Mapping[str, float]) -> str:
    """What tells the files of several levels apart."""
    return f"{share * gamma if gamma else next(iter(own.values()), 0.0):.3g}"


def _region(text: str) -> tuple[str, float]:
    name, _, level = text.partition("=")
    try:
        value = float(level)
    except ValueError:
        value = np.nan
    if not name or not np.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text}: expected NAME=LEVEL, as nose=0.4")
    return name, value


def main(arguments: list[str] | None = None) -> int:
    """Exit code 1 and one line for what is wrong with the input."""
    parser = argparse.ArgumentParser(
        "python -m carigs.cli.mesh", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("mesh", type=Path, help=f"the neutral head: {' '.join(FORMATS)}")
    parser.add_argument("--gamma", type=float, default=0.25, help="level; 0 is the mesh itself (default %(default)s)")
    parser.add_argument(
        "--region", type=_region, action="append", default=[], metavar="NAME=LEVEL", help="a region's own level"
    )
    parser.add_argument(
        "--regions", type=Path, metavar="FILE", help="names of regions: FLAME_masks.pkl, a head model, .npz or .json"
    )
    parser.add_argument("--levels", type=int, default=1, help="files at equal steps up to gamma (default %(default)s)")
    parser.add_argument("--preset", choices=known("exaggerate"), default="robust", help="(default %(default)s)")
    parser.add_argument("-o", "--output", type=Path, required=True, help="mesh to write")
    parser.add_argument("--preview", type=Path, help="PNG to write (default: beside the output)")
    given = parser.parse_args(arguments)
    if given.levels < 1:
        parser.error(f"--levels {given.levels}: expected 1 or more")
    if not np.isfinite(given.gamma):
        parser.error(f"--gamma {given.gamma}: expected a number")
    picture = given.preview or given.output.with_suffix(".png")
    try:
        exaggerate(
            given.mesh,
            given.gamma,
            dict(given.region),
            given.regions,
            given.levels,
            given.preset,
            given.output,
            picture,
        )
    except CarigsError as error:
        print(f"carigs: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
