"""Rendering of hair strands: camera-facing ribbons of triangles, shaded at their vertices."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float32, Int32

from carigs.toy.look.lighting import KEY_COLOUR, StudioLight
from carigs.toy.look.strands import RootedStrands


def ribbon_faces(strands: int, knots: int, first: int) -> Int32[np.ndarray, "f 3"]:
    """Faces of the ribbons: two triangles between neighbouring knots, two vertices to a knot.

    Args:
        strands: Number of strands.
        knots: Points of a strand.
        first: Index of the first vertex.

    Returns:
        Vertex indices.
    """
    row = first + 2 * (np.arange(strands)[:, None] * knots + np.arange(knots - 1)).reshape(-1)
    offsets = np.array([[0, 1, 2], [1, 3, 2]], np.int32)
    return (row[:, None] + offsets[:, None]).reshape(-1, 3).astype(np.int32)


def strand_ribbons(
    strands: RootedStrands,
    colour: Float[np.ndarray, "s 3"],
    roots: Float[np.ndarray, "s 3"],
    axes: Float[np.ndarray, "s 3 3"],
    unit: float,
    eye: Float[np.ndarray, "3"],
    light: StudioLight,
) -> tuple[Float[np.ndarray, "r 3"], Float32[np.ndarray, "r 3"]]:
    """Vertices of the ribbons and their colours, with the diffuse and specular terms of Kajiya and Kay (1989).

    Args:
        strands: The strands.
        colour: Their linear colours.
        roots: World positions of their roots, in metres.
        axes: Frames of the triangles that they are bound to, in world axes (see `triangle_frames`).
        unit: Length in metres of the unit of `strands`.
        eye: World position of the camera that the ribbons face, in metres.
        light: The light of the studio.

    Returns:
        Positions in metres and linear colours of the vertices.
    """
    # Arrays are (3, k, s): inner loops run over the strands.
    local, normals = np.ascontiguousarray(strands.local.T), np.ascontiguousarray(axes[:, 2])
    colour, ambient = colour.T[:, None].astype(float), light.ambient(normals).T[:, None]
    key, key_colour = light.key_direction[:, None, None], KEY_COLOUR[:, None, None]
    points = roots.T[:, None] + unit * sum(local[i] * axes[:, i].T[:, None] for i in range(3))
    ends = np.pad(points, ((0, 0), (1, 1), (0, 0)), "edge")
    tangent, view = ends[:, 2:] - ends[:, :-2], eye[:, None, None] - points
    tangent /= np.linalg.norm(tangent, axis=0) + 1e-20
    view /= np.linalg.norm(view, axis=0)
    side = tangent[[1, 2, 0]] * view[[2, 0, 1]] - tangent[[2, 0, 1]] * view[[1, 2, 0]]  # their cross product
    t = np.arange(len(local[0]))[:, None] / (len(local[0]) - 1)
    half = 0.5 * unit * strands.width.astype(float) * (1.0 - 0.8 * t * t)
    side *= half / (np.linalg.norm(side, axis=0) + 1e-9)
    along, seen = (tangent * key).sum(axis=0), (tangent * view).sum(axis=0)
    across = np.sqrt(np.maximum(1.0 - along * along, 0.0))
    shine = np.maximum(across * np.sqrt(np.maximum(1.0 - seen * seen, 0.0)) - along * seen, 0.0)
    toward = np.maximum(0.35 + 0.65 * (normals @ light.key_direction), 0.0)
    value = colour * (ambient + 0.9 * key_colour * across * toward)
    value += toward * key_colour * (0.045 * shine**60 + 0.22 * colour * shine**14)
    ribbons = np.stack([(points - side).T, (points + side).T], axis=2)
    colours = (strands.shade.T * value).astype(np.float32).T
    return ribbons.reshape(-1, 3), np.repeat(colours.reshape(-1, 3), 2, axis=0)
