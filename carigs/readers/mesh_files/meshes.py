"""Reader of meshes: OBJ, PLY, OFF, GLB, and STL by trimesh, behind limits and one type of error."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from carigs.errors import CarigsWarning, InputError
from carigs.readers.limits import MAX_TEXT_BYTES, read_bytes
from carigs.readers.mesh_files.glb import parse_glb, parse_gltf
from carigs.readers.mesh_files.obj import parse_obj
from carigs.readers.mesh_files.off import parse_off
from carigs.readers.mesh_files.ply import parse_ply_polygons
from carigs.readers.mesh_files.polygons import Polygons, triangulate_polygons
from carigs.readers.text import decode_text, split_lines, without_byte_order_mark

if TYPE_CHECKING:
    import trimesh

MAX_FACES = 20_000_000
MAX_COORDINATE = 1e15
"""Largest coordinate without its sign: areas and volumes must stay finite in float64, and in float32 after scaling."""


def read_mesh(file: str | Path) -> trimesh.Trimesh:
    """Read a mesh of triangles; polygons are cut into triangles.

    Args:
        file: A file in one of `FORMATS`.

    Returns:
        The mesh, its vertices in the file's order.

    Raises:
        InputError: As for `read_polygons`, and for too many corners of polygons that are not convex.

    Warns:
        CarigsWarning: A polygon crosses itself.
    """
    import trimesh

    polygons = read_polygons(file)
    return trimesh.Trimesh(polygons.vertices, triangulate_polygons(polygons, file), process=False)


def read_polygons(file: str | Path) -> Polygons:
    """Read a mesh; materials and textures are ignored, and no other file is opened but buffers of a .gltf.

    Args:
        file: A file in one of `FORMATS`.

    Returns:
        Positions and faces in the file's order.

    Raises:
        InputError: If the file is missing, of an unknown format, too large or damaged, if it holds no faces, if a face
            names a vertex that does not exist, or if a coordinate is not finite.
    """
    file = Path(file)
    parse = PARSERS.get(file.suffix.lower())
    if parse is None:
        raise InputError(f"unknown kind of mesh; known: {' '.join(FORMATS)}", file=file)
    polygons = parse(read_bytes(file, MAX_TEXT_BYTES, "mesh"), file)
    vertices, corners, lengths = polygons
    if len(lengths) == 0:
        raise InputError("holds no triangles", file=file)
    if (count := len(corners) - 2 * len(lengths)) > MAX_FACES:
        raise InputError(f"{count} triangles; at most {MAX_FACES} are read", file=file)
    if corners.min() < 0 or corners.max() >= len(vertices):
        raise InputError(f"faces must name vertices 0..{len(vertices) - 1}", file=file, field="faces")
    used = np.unique(corners)
    if (bad := used[~(np.abs(vertices[used]) < MAX_COORDINATE).all(axis=1)]).size:
        problem = f"is not finite, or a coordinate is {MAX_COORDINATE:g} or more"
        raise InputError(f"vertex {bad[0]} {problem}", file=file, field="vertices")
    return polygons


def _parse_stl(content: bytes, file: str | Path) -> Polygons:
    """Parse the triangles of an .stl file, each of which has vertices of its own."""
    import trimesh

    size = 84 + 50 * int.from_bytes(content[80:84], "little")
    if len(content) != size and _is_text(content, file):
        # Only names and comments may be anything but ASCII; trimesh before 5 would guess their encoding by chardet.
        content = "\n".join(split_lines(decode_text(content, file, any_bytes=True))).encode("ascii", "replace")
    elif len(content) < size:
        raise InputError(f"not a readable mesh (cut off: {len(content)} of {size} bytes)", file=file)
    elif size < len(content):
        warnings.warn(
            f"{file}: {len(content) - size} bytes after its triangles are left out", CarigsWarning, stacklevel=2
        )
        content = content[:size]
    try:
        mesh = trimesh.load(io.BytesIO(content), file_type="stl", process=False, maintain_order=True, force="mesh")
    except Exception as error:  # trimesh's readers raise whatever their format's parser does
        raise InputError(f"not a readable mesh ({type(error).__name__}: {str(error)[:200]})", file=file) from error
    if not isinstance(mesh, trimesh.Trimesh):
        raise InputError("holds no triangles", file=file)
    return _triangles(np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64))


def _is_text(content: bytes, file: str | Path) -> bool:
    start = without_byte_order_mark(content, file)[:4096].lstrip()
    return start.startswith(b"solid") and re.search(b"facet|endsolid", start) is not None  # some binary ones say solid


def _parse_glb(content: bytes, file: str | Path) -> Polygons:
    return _triangles(*parse_glb(content, file))


def _parse_gltf(content: bytes, file: str | Path) -> Polygons:
    return _triangles(*parse_gltf(content, file))


def _triangles(vertices: np.ndarray, faces: np.ndarray) -> Polygons:
    return Polygons(vertices, faces.ravel(), np.full(len(faces), 3))


PARSERS: dict[str, Callable[[bytes, Path], Polygons]] = {
    ".obj": parse_obj, ".ply": parse_ply_polygons, ".stl": _parse_stl, ".off": parse_off, ".glb": _parse_glb,
    ".gltf": _parse_gltf,
}  # fmt: skip
FORMATS = tuple(PARSERS)
