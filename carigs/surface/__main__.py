"""Exaggerate a mesh: python -m carigs.surface head.obj --gamma 0.25 -o caricature.ply

The mesh is checked first and what was mended is told; the result has the vertices of the file, in their order.  Units
do not matter; for the preview +y is up and the face looks along +z.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np
import trimesh

from carigs.config import compose, known
from carigs.errors import CarigsError, InputError
from carigs.settings import Exaggerate
from carigs.surface.cleaning import clean_mesh
from carigs.surface.exaggeration import Exaggerator
from evaluation.clay import clay_sheet

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


def exaggerate(file: Path, gamma: float, levels: int, preset: str, output: Path, picture: Path) -> None:
    """Read, check, solve, write `output` (with several levels one file for each) and the picture."""
    started = time.perf_counter()

    def say(text: str) -> None:
        print(f"{time.perf_counter() - started:6.2f} s  {text}", flush=True)

    if output.suffix.lower() not in FORMATS:
        raise InputError(f"unknown kind of mesh; known: {' '.join(FORMATS)}", file=output)
    for written in (output, picture):
        if not written.parent.is_dir():
            raise InputError("no such folder", file=written.parent)
    mesh = read_mesh(file)
    clean = clean_mesh(mesh.vertices, mesh.faces)
    say(str(clean.report))
    settings = Exaggerate(**compose(f"exaggerate={preset}").exaggerate)
    exaggerator = Exaggerator(clean.vertices, clean.faces, settings)
    say("factorised")
    shown = {"level 0": clean.vertices}
    for level in gamma * (1 + np.arange(levels)) / levels:
        displacement = exaggerator.solve(float(level))
        result = mesh.copy()
        result.vertices = np.asarray(mesh.vertices) + clean.to_given(displacement)
        target = output if levels == 1 else output.with_stem(f"{output.stem}_{level:.3g}")
        result.export(target)
        shown[f"level {level:.3g}"] = clean.vertices + displacement
        say(f"{target}: moved by up to {np.linalg.norm(displacement, axis=1).max():.4g}")
    clay_sheet(picture, shown, clean.faces)
    say(str(picture))


def main(arguments: list[str] | None = None) -> int:
    """Exit code 1 and one line for what is wrong with the input."""
    parser = argparse.ArgumentParser(
        "python -m carigs.surface", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("mesh", type=Path, help=f"the neutral head: {' '.join(FORMATS)}")
    parser.add_argument("--gamma", type=float, default=0.25, help="level; 0 is the mesh itself (default %(default)s)")
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
        exaggerate(given.mesh, given.gamma, given.levels, given.preset, given.output, picture)
    except CarigsError as error:
        print(f"carigs: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
