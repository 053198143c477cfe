"""FLAME's teeth: two strips behind the lips, 120 vertices and 168 faces, as in the tracked data of GaussianAvatars.

They move with skull and jaw and are not exaggerated: the teeth of a caricature are built behind its deformed lips.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int

from carigs.exaggeration.gamma_path import GammaPath

FLAME_COUNTS = (5023, 9976)
"""Numbers of vertices and faces of FLAME."""
ROW_LENGTH = 15  # vertices of a row, from one corner of the mouth to the other
ROWS = (
    "upper_root", "lower_root", "upper_edge", "lower_edge",
    "upper_root_back", "upper_edge_back", "lower_root_back", "lower_edge_back",
)  # fmt: skip
TEETH_COUNTS = (len(ROWS) * ROW_LENGTH, 168)
FLAME_WITH_TEETH_COUNTS = (FLAME_COUNTS[0] + TEETH_COUNTS[0], FLAME_COUNTS[1] + TEETH_COUNTS[1])

UPPER_LIP = (1713, 1715, 1716, 1735, 1696, 1694, 1657, 3543, 2774, 2811, 2813, 2850, 2833, 2832, 2830)
LOWER_LIP = (1576, 1577, 1773, 1774, 1795, 1802, 1865, 3503, 2948, 2905, 2898, 2881, 2880, 2713, 2712)

# The two triangles of a quad between columns 0 and 1, left | right of the middle. r, e: root and edge, capitals: back.
STRIPS = {
    "upper": (
        "r0 e1 e0, r0 r1 e1 | r0 r1 e0, r1 e1 e0",
        "R0 E0 E1, R0 E1 R1 | R0 E0 R1, R1 E0 E1",
        "E0 e0 E1, E1 e0 e1 | E0 e0 e1, E0 e1 E1",
    ),
    "lower": (
        "e0 e1 r0, e1 r1 r0 | e0 r1 r0, e0 e1 r1",
        "R0 E1 E0, R0 R1 E1 | R0 R1 E0, R1 E1 E0",
        "E0 E1 e0, E1 e1 e0 | E0 e1 e0, E0 E1 e1",
    ),
}


def skin_counts(vertices: int, faces: int) -> tuple[int, int]:
    """Numbers of vertices and faces of the skin, which come before those of the teeth.

    Args:
        vertices: Number of vertices of a head.
        faces: Number of its faces.

    Returns:
        The numbers without FLAME's teeth.
    """
    return FLAME_COUNTS if (vertices, faces) == FLAME_WITH_TEETH_COUNTS else (vertices, faces)


def teeth_vertices(
    head: Float[np.ndarray, "v 3"], natural: Float[np.ndarray, "v 3"] | None = None
) -> Float[np.ndarray, "120 3"]:
    """Build the vertices of the teeth behind the lips of a head.

    Length and thickness are proportional to the mean distance of the outer rings of the lips.

    Args:
        head: Vertices of FLAME (y up, face towards +z), in any unit.
        natural: For a caricature, the natural head. The teeth then keep their natural proportions and scale with the
            arch of the lips; swollen lips alone would make them long and thick.

    Returns:
        Vertices of the teeth, in the unit of the head, in the order of `ROWS`.
    """
    unit, arch = _lip_arch(head)
    if natural is not None:
        natural_unit, natural_arch = _lip_arch(natural)
        unit = natural_unit * _length(arch) / _length(natural_arch)
    up, forward = unit * np.array([0, 1.0, 0]), unit * np.array([0, 0, 1.0])
    arch = np.column_stack([arch[:, 0], np.full(ROW_LENGTH, arch[:, 1].mean()), arch[:, 2]]) - 1.5 * forward
    rows = {"upper_edge": arch + 0.1 * up, "lower_edge": arch - 0.1 * up - 0.4 * forward}
    rows |= {"upper_root": rows["upper_edge"] + 2 * up, "lower_root": rows["lower_edge"] - 2 * up}
    rows |= {f"{name}_back": row - forward for name, row in rows.items()}
    return np.concatenate([rows[name] for name in ROWS])


def is_upper_tooth() -> Bool[np.ndarray, "120"]:
    """Whether each vertex of the teeth belongs to the upper jaw.

    Returns:
        A mask over the vertices of the teeth.
    """
    return np.array([name.startswith("upper") for name in ROWS]).repeat(ROW_LENGTH)


def teeth_faces() -> Int[np.ndarray, "168 3"]:
    """Faces of the teeth.

    Returns:
        Vertex indices of the triangles, counted from the first vertex of the teeth.
    """
    faces = []
    for jaw, strips in STRIPS.items():
        first = {
            letter: ROW_LENGTH * ROWS.index(f"{jaw}_{name}")
            for letter, name in (("r", "root"), ("e", "edge"), ("R", "root_back"), ("E", "edge_back"))
        }
        for strip in strips:
            left, right = strip.split(" | ")
            for i in range(ROW_LENGTH - 1):
                for triangle in (left if i <= 6 else right).split(", "):
                    faces.append([first[corner[0]] + i + int(corner[1]) for corner in triangle.split()])
    return np.array(faces)


def add_teeth(path: GammaPath, neutral: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> GammaPath:
    """Extend the path of a head's skin to the whole head; the teeth are built anew at every node.

    Args:
        path: Path of the skin.
        neutral: Vertices of the whole head, in metres.
        faces: Faces of the whole head.

    Returns:
        Path of the whole head; the same path if the head has no teeth.
    """
    if len(neutral) == len(path.neutral):
        return path
    natural = teeth_vertices(path.neutral)
    teeth = [teeth_vertices(path.neutral + u, path.neutral) - natural for u in path.displacements]
    changes = path.changes
    if changes is not None:
        changes = np.pad(changes, ((0, 0), (0, 0), (0, TEETH_COUNTS[0]), (0, 0)))  # only joints move the teeth
    displacements = np.concatenate([path.displacements, np.array(teeth, np.float32)], axis=1)
    return replace(path, displacements=displacements, faces=faces, neutral=neutral, changes=changes)


def without_teeth(path: GammaPath) -> GammaPath:
    """Restrict the path of a head to its skin.

    Args:
        path: Path of the whole head.

    Returns:
        Path of the skin.
    """
    v, f = skin_counts(len(path.neutral), len(path.faces))
    changes = None if path.changes is None else path.changes[:, :, :v]
    return replace(
        path, displacements=path.displacements[:, :v], faces=path.faces[:f], neutral=path.neutral[:v], changes=changes
    )


def _lip_arch(head: Float[np.ndarray, "v 3"]) -> tuple[float, Float[np.ndarray, "15 3"]]:
    """Mean distance of the lips' outer rings, and the curve midway between them."""
    upper, lower = head[list(UPPER_LIP)], head[list(LOWER_LIP)]
    return float(np.linalg.norm(upper - lower, axis=1).mean()), (upper + lower) / 2


def _length(curve: Float[np.ndarray, "n 3"]) -> float:
    return float(np.linalg.norm(np.diff(curve, axis=0), axis=1).sum())
