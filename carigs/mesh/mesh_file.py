"""Mesh files with other vertex positions: what else a file holds is kept where its format allows."""

from __future__ import annotations

import os
import re
import warnings
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from carigs.errors import CarigsWarning, InputError
from carigs.mesh.ply_writer import ply_content
from carigs.mesh.triangle_mesh import vertex_normals
from carigs.readers.limits import MAX_TEXT_BYTES, read_bytes
from carigs.readers.mesh_files.obj import obj_lines
from carigs.readers.mesh_files.ply import parse_ply
from carigs.readers.text import encode_text

_TEXTURE_COORDINATES = re.compile(rb"^vt |^property .*\b(?:s|u|texture_u|texcoord)\s*$|\"TEXCOORD_0\"", re.MULTILINE)
"""How .obj, .ply and .glb announce texture coordinates."""


def moved_mesh_file(
    source: Path, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], output: Path
) -> bytes:
    """Compose a mesh file from another one and new positions of its vertices.

    From .obj to .obj and from .ply to .ply everything else in the file is kept: texture coordinates, references to
    materials and textures, polygons, groups, colours. Normals of an .obj are left out, those of a .ply are computed
    again. Other pairs of formats keep vertices and triangles. No file beside the output is needed or written.

    Args:
        source: The mesh file that `read_mesh` read.
        vertices: New positions, in the order of the file.
        faces: Triangles of the file, as vertex numbers.
        output: Where the content will be stored. Its suffix is the format; references to other files are relative to
            its folder.

    Returns:
        Content of the new file.

    Raises:
        InputError: If the source has changed since it was read, or its vertices have lists as coordinates.
    """
    import trimesh

    content = read_bytes(source, MAX_TEXT_BYTES, "mesh")
    formats = source.suffix.lower(), output.suffix.lower()
    if formats == (".obj", ".obj"):
        return _moved_obj(content, vertices, source, output)
    if formats == (".ply", ".ply"):
        return _moved_ply(content, vertices, faces, source, output)
    if _TEXTURE_COORDINATES.search(content.replace(b"\r", b"\n")):
        kept = ".obj to .obj and .ply to .ply keep them"
        warnings.warn(f"{output}: without the texture coordinates of {source}; {kept}", CarigsWarning, stacklevel=2)
    exported = trimesh.Trimesh(vertices, faces, process=False).export(file_type=formats[1][1:])
    return exported.encode() if isinstance(exported, str) else exported


def _moved_obj(content: bytes, vertices: Float[np.ndarray, "v 3"], source: Path, output: Path) -> bytes:
    """The lines of an .obj file with other positions. Lines of vertices that do not move stay as they are."""
    lines, index = [], 0
    for line in obj_lines(content, source):
        words = line.split()
        match words[:1]:
            case ["v"]:
                if index < len(vertices) and not _same(words[1:4], vertices[index]):
                    line = " ".join(["v", *(f"{x:.12g}" for x in vertices[index]), *words[4:]])
                index += 1
            case ["vn"]:
                continue
            case ["f"]:
                line = " ".join(["f", *("/".join(word.split("/")[:2]).rstrip("/") for word in words[1:])])
            case ["mtllib"]:
                line = f"mtllib {_reference(line.split(None, 1)[-1].strip(), source, output)}"
        lines.append(line)
    _check_count(index, vertices, source)
    return encode_text(("\r\n" if b"\r\n" in content else "\n").join(lines))


def _moved_ply(
    content: bytes, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], source: Path, output: Path
) -> bytes:
    """A .ply file with other positions, and normals if it had any."""
    ply = parse_ply(content, source)
    rows = ply.elements.get("vertex", np.empty(0))
    _check_count(len(rows), vertices, source)
    columns = dict(zip("xyz", vertices.T, strict=True))
    if {"nx", "ny", "nz"} <= set(rows.dtype.names):
        columns |= dict(zip(("nx", "ny", "nz"), vertex_normals(vertices, faces).T, strict=True))
    for name in columns:
        if rows.dtype[name].kind not in "iuf":
            raise InputError("a list, expected a number", file=source, field=f"vertex.{name}")
    # Positions stored as whole numbers become floating-point numbers.
    fields = [(name, "f4" if name in columns and kind[1] != "f" else kind, *n) for name, kind, *n in rows.dtype.descr]
    moved = rows.astype(fields)
    for name, column in columns.items():
        moved[name] = column
    comments = [
        f"TextureFile {_reference(text.split(None, 1)[1], source, output)}" if text.startswith("TextureFile ") else text
        for text in ply.comments
    ]
    return ply_content(ply._replace(elements=ply.elements | {"vertex": moved}, comments=comments))


def _same(words: list[str], position: Float[np.ndarray, "3"]) -> bool:
    """Whether a position is the one in the file; one that is not finite belongs to an unused vertex."""
    return all(float(word) == x or not np.isfinite(x) for word, x in zip(words, position, strict=True))


def _reference(name: str, source: Path, output: Path) -> str:
    """The name of a file beside the source as seen from the output's folder."""
    folders = source.resolve().parent, output.resolve().parent
    return name if folders[0] == folders[1] or not name else os.path.relpath(folders[0] / name, folders[1])


def _check_count(count: int, vertices: Float[np.ndarray, "v 3"], source: Path) -> None:
    """Refuse a file that has another number of vertices than before."""
    if count != len(vertices):
        raise InputError(f"{count} vertices, {len(vertices)} a moment ago", file=source)
