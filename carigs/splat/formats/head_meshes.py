"""The head's mesh at a level as .obj, .ply and glTF, and the gamma path as morph targets of glTF.

The posed mesh at a level is the polynomial of the gamma path through the posed meshes at its nodes, because linear
blend skinning with given rotations is affine in the displacement. Morph targets with the Lagrange weights of a level
therefore give exactly the mesh of this level.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float64
from numpy.polynomial import Polynomial

from carigs.exaggeration import GammaPath
from carigs.mesh.ply_writer import ply_content
from carigs.mesh.triangle_mesh import vertex_normals
from carigs.readers.mesh_files.ply import LENGTH, Ply
from carigs.splat.formats.baked_colours import linear_colours
from carigs.splat.formats.gltf import ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, TRIANGLES, GltfBuffer, write_gltf
from carigs.splat.rig.head_sequence import HeadSequence
from carigs.system.files import writing

HEAD_NODE = {"name": "head", "mesh": 0}
UNLIT = "KHR_materials_unlit"
SECONDS = 2.0
"""Length of the animation from level 0 to gamma_f."""
CUBIC, KEYFRAMES = 3, 33
"""Highest degree that one cubic segment between two keyframes represents, and keyframes of paths of higher degree."""


def posed_path(sequence: HeadSequence, timestep: int) -> GammaPath:
    """Path through the posed meshes of a timestep.

    Args:
        sequence: The subject.
        timestep: Timestep of the capture.

    Returns:
        The path, in world coordinates; its neutral is the posed mesh of level 0.
    """
    levels = sequence.path.levels
    posed = np.stack([sequence.posed(timestep, float(level)) for level in levels])
    return GammaPath(levels, (posed - posed[0]).astype(np.float32), sequence.head.faces, posed[0])


def level_vertices(path: GammaPath, level: float) -> Float64[np.ndarray, "v 3"]:
    """Vertices of a path at a level.

    Args:
        path: The path.
        level: Exaggeration, 0 for the natural head.

    Returns:
        Positions in metres.
    """
    return path.neutral + path.displacement(level)


def write_mesh(file: Path, path: GammaPath, level: float, colours: Float[np.ndarray, "v 3"] | None = None) -> None:
    """Write the mesh of a level; its suffix is the format.

    Args:
        file: Path to write: .obj, .ply, .glb or .gltf.
        path: Path of the head.
        level: Exaggeration, 0 for the natural head.
        colours: sRGB in [0, 1] of the vertices; None for a mesh without colours.
    """
    vertices, faces = level_vertices(path, level), path.faces
    suffix = file.suffix.lower()
    if suffix == ".obj":
        rows = vertices if colours is None else np.concatenate([vertices, colours], axis=1)
        lines = [f"v {' '.join(f'{number:.9g}' for number in row)}" for row in rows.tolist()]
        lines += [f"f {i} {j} {k}" for i, j, k in faces + 1]
        with writing(file) as part:
            part.write_text("\n".join([*lines, ""]))
    elif suffix == ".ply":
        with writing(file) as part:
            part.write_bytes(ply_content(_ply(vertices, faces, colours)))
    else:
        buffer = GltfBuffer()
        primitive = mesh_primitive(buffer, vertices, faces, colours)
        document = {"nodes": [HEAD_NODE], "meshes": [{"name": "head", "primitives": [primitive]}]}
        write_gltf(file, buffer, document | surface(colours))


def write_morph_targets(
    file: Path, path: GammaPath, level: float, colours: Float[np.ndarray, "v 3"] | None = None
) -> None:
    """Write the mesh of level 0 with the nodes of the path as morph targets, and an animation from 0 to gamma_f.

    Weights of targets at a level are the Lagrange polynomials of the path (`GammaPath.weights`), without that of level
    0. Their keyframes are cubic splines, which hold polynomials of up to four nodes exactly. `extras` of the mesh state
    the levels.

    Args:
        file: Path to write: .glb or .gltf.
        path: Path of the head.
        level: Level that is shown at first.
        colours: sRGB in [0, 1] of the vertices; None for a mesh without colours.
    """
    buffer = GltfBuffer()
    primitive = mesh_primitive(buffer, path.neutral, path.faces, colours)
    normals = vertex_normals(path.neutral, path.faces)
    primitive["targets"] = [
        {
            "POSITION": buffer.add(displacement, ARRAY_BUFFER, bounds=True),
            "NORMAL": buffer.add(vertex_normals(path.neutral + displacement, path.faces) - normals, ARRAY_BUFFER),
        }
        for displacement in path.displacements[1:]
    ]
    levels = path.levels.tolist()
    mesh = {
        "name": "head",
        "primitives": [primitive],
        "weights": path.weights(level)[1:].tolist(),
        "extras": {"targetNames": [f"level={node:g}" for node in levels[1:]], "levels": levels, "level": level},
    }
    times, splines = weight_splines(path)
    sampler = {
        "input": buffer.add(times, bounds=True),
        "output": buffer.add(splines.reshape(-1)),
        "interpolation": "CUBICSPLINE",
    }
    channel = {"sampler": 0, "target": {"node": 0, "path": "weights"}}
    animation = {"name": f"level 0 to {path.gamma_f:g}", "samplers": [sampler], "channels": [channel]}
    document = {"nodes": [HEAD_NODE], "meshes": [mesh], "animations": [animation]}
    write_gltf(file, buffer, document | surface(colours))


def weight_splines(path: GammaPath) -> tuple[Float[np.ndarray, " t"], Float[np.ndarray, "t 3 j"]]:
    """Keyframes of the morph targets' weights along the path, as glTF's cubic splines.

    Args:
        path: The path.

    Returns:
        Times in seconds; and at each time the derivative per second from the left, the value, and the derivative from
        the right of every weight.
    """
    nodes = path.levels / path.gamma_f
    parameter = np.linspace(0, 1, 2 if len(nodes) - 1 <= CUBIC else KEYFRAMES)
    keyframes = np.empty((len(parameter), 3, len(nodes) - 1))
    for j in range(1, len(nodes)):
        weight = Polynomial.fromroots(np.delete(nodes, j))
        weight /= weight(nodes[j])
        keyframes[:, 1, j - 1] = weight(parameter)
        keyframes[:, [0, 2], j - 1] = weight.deriv()(parameter)[:, None] / SECONDS
    return SECONDS * parameter, keyframes


def mesh_primitive(
    buffer: GltfBuffer, vertices: Float[np.ndarray, "v 3"], faces: np.ndarray, colours: np.ndarray | None = None
) -> dict[str, Any]:
    """Append a mesh with normals.

    Args:
        buffer: Receives its arrays.
        vertices: Positions in metres.
        faces: Vertex indices of the triangles.
        colours: sRGB in [0, 1] of the vertices, which glTF stores as linear values; None for none.

    Returns:
        The primitive; `surface` has its material.
    """
    attributes = {
        "POSITION": buffer.add(vertices, ARRAY_BUFFER, bounds=True),
        "NORMAL": buffer.add(vertex_normals(vertices, faces), ARRAY_BUFFER),
    }
    if colours is not None:
        attributes["COLOR_0"] = buffer.add(linear_colours(colours), ARRAY_BUFFER)
    indices = buffer.add(faces.reshape(-1), ELEMENT_ARRAY_BUFFER)
    primitive = {"attributes": attributes, "indices": indices, "mode": TRIANGLES}
    return primitive if colours is None else primitive | {"material": 0}


def surface(colours: np.ndarray | None) -> dict[str, Any]:
    """Material of a mesh whose colours are those of photographs: their light is in them, and no other is added.

    Args:
        colours: Colours of the vertices; None for none.

    Returns:
        Entries of the document; none without colours.
    """
    if colours is None:
        return {}
    base = {"baseColorFactor": [1, 1, 1, 1], "metallicFactor": 0, "roughnessFactor": 0.7}
    material = {"name": "skin", "pbrMetallicRoughness": base, "extensions": {UNLIT: {}}}
    return {"materials": [material], "extensionsUsed": [UNLIT]}


def _ply(vertices: Float[np.ndarray, "v 3"], faces: np.ndarray, colours: np.ndarray | None) -> Ply:
    named = () if colours is None else ("red", "green", "blue")
    corners = np.empty(len(vertices), [*((axis, "<f4") for axis in "xyz"), *((name, "u1") for name in named)])
    for name, values in zip(named, () if colours is None else colours.T, strict=True):
        corners[name] = np.rint(255 * values)
    for axis, values in zip("xyz", vertices.T, strict=True):
        corners[axis] = values
    name = "vertex_indices"
    triangles = np.empty(len(faces), [(name + LENGTH, "u1"), (name, "<i4", 3)])
    triangles[name + LENGTH], triangles[name] = 3, faces
    return Ply("binary_little_endian", {"vertex": corners, "face": triangles})
