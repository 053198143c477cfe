"""Reader of triangle meshes: OBJ and GLB, and PLY, STL and OFF by trimesh, behind limits and one type of error."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from carigs.errors import InputError
from carigs.readers.glb import parse_glb
from carigs.readers.limits import MAX_TEXT_BYTES, read_bytes
from carigs.readers.obj import parse_obj
from carigs.readers.ply_header import parse_ply_header

if TYPE_CHECKING:
    import trimesh

PARSERS = {"obj": parse_obj, "glb": parse_glb}
"""Functions of `carigs.readers` by the kind of file; trimesh reads the others."""
FORMATS = (".obj", ".ply", ".stl", ".off", ".glb")
MAX_FACES = 20_000_000
MAX_COORDINATE = 1e15
"""Largest coordinate without its sign: areas and volumes must stay finite in float64, and in float32 after scaling."""


def read_mesh(file: str | Path) -> trimesh.Trimesh:
    """Read a mesh; materials and textures are ignored, and no other file is opened.

    Args:
        file: A file in one of `FORMATS`.

    Returns:
        The mesh, its vertices in the file's order.

    Raises:
        InputError: If the file is missing, of an unknown format, too large or damaged, if it holds no triangles, if a
            face names a vertex that does not exist, or if a coordinate is not finite.
    """
    import trimesh

    file = Path(file)
    if file.suffix.lower() not in FORMATS:
        raise InputError(f"unknown kind of mesh; known: {' '.join(FORMATS)}", file=file)
    content = read_bytes(file, MAX_TEXT_BYTES, "mesh")
    mesh = _load(content, file)
    if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0:
        raise InputError("holds no triangles", file=file)
    if len(mesh.faces) > MAX_FACES:
        raise InputError(f"{len(mesh.faces)} triangles; at most {MAX_FACES} are read", file=file)
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise InputError(f"faces must name vertices 0..{len(vertices) - 1}", file=file, field="faces")
    used = np.unique(faces)
    if (bad := used[~(np.abs(vertices[used]) < MAX_COORDINATE).all(axis=1)]).size:
        problem = f"is not finite, or a coordinate is {MAX_COORDINATE:g} or more"
        raise InputError(f"vertex {bad[0]} {problem}", file=file, field="vertices")
    return mesh


def _load(content: bytes, file: Path) -> object:
    """Parse a file; the result is a `Trimesh` only if it holds triangles."""
    import trimesh

    kind = file.suffix[1:].lower()
    if kind in PARSERS:
        vertices, faces = PARSERS[kind](content, file)
        return trimesh.Trimesh(vertices, faces, process=False)
    options = {}
    if kind == "ply":
        parse_ply_header(content, file)  # refuses what claims too much
        options["fix_texture"] = False  # splits vertices, which changes their numbers
    try:
        return trimesh.load(
            io.BytesIO(content), file_type=kind, process=False, maintain_order=True, force="mesh", skip_materials=True,
            **options,
        )  # fmt: skip
    except Exception as error:  # trimesh's readers raise whatever their format's parser does
        raise InputError(f"not a readable mesh ({type(error).__name__}: {str(error)[:200]})", file=file) from error
