"""FLAME's teeth: two strips behind the lips, 120 vertices and 168 faces, as the field's tracked data has them.

They hang on the skull and on the jaw and are no part of the exaggeration: a caricature gets teeth of its own, built
behind the deformed lips.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from carigs.exaggeration.gamma_path import GammaPath
from carigs.head.model import N_SHAPE, HeadModel

FLAME = (5023, 9976)
"""Vertices and faces."""
COLUMN = 15  # vertices of a row, from one corner of the mouth to the other
ROWS = (
    "upper_root", "lower_root", "upper_edge", "lower_edge",
    "upper_root_back", "upper_edge_back", "lower_root_back", "lower_edge_back",
)  # fmt: skip
ADDED = (len(ROWS) * COLUMN, 168)
WITH_TEETH = (FLAME[0] + ADDED[0], FLAME[1] + ADDED[1])

UPPER_LIP = (1713, 1715, 1716, 1735, 1696, 1694, 1657, 3543, 2774, 2811, 2813, 2850, 2833, 2832, 2830)
LOWER_LIP = (1576, 1577, 1773, 1774, 1795, 1802, 1865, 3503, 2948, 2905, 2898, 2881, 2880, 2713, 2712)

# The two triangles of a quad between columns 0 and 1, left | right of the middle.  r, e: root and edge, capitals: back.
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


def skin(vertices: int, faces: int) -> tuple[int, int]:
    """How many of these vertices and faces are no teeth: they come first."""
    return FLAME if (vertices, faces) == WITH_TEETH else (vertices, faces)


def teeth(
    lips: Float[np.ndarray, "v 3"], natural: Float[np.ndarray, "v 3"] | None = None
) -> Float[np.ndarray, "120 3"]:
    """Vertices of the teeth behind the lips of FLAME's `lips` (y up, face towards +z; any unit).

    Their length and thickness are in proportion to the mean distance of the lips' outer rings.  Lips that were
    exaggerated say where teeth stand and how wide their arch is; with the `natural` head beside them the proportions of
    the natural teeth are kept, where swollen lips alone would make them long and thick.
    """
    unit, middle = _arch(lips)
    if natural is not None:
        natural_unit, natural_middle = _arch(natural)
        unit = natural_unit * _length(middle) / _length(natural_middle)
    up, ahead = unit * np.array([0, 1.0, 0]), unit * np.array([0, 0, 1.0])
    middle = np.column_stack([middle[:, 0], np.full(COLUMN, middle[:, 1].mean()), middle[:, 2]]) - 1.5 * ahead
    rows = {"upper_edge": middle + 0.1 * up, "lower_edge": middle - 0.1 * up - 0.4 * ahead}
    rows |= {"upper_root": rows["upper_edge"] + 2 * up, "lower_root": rows["lower_edge"] - 2 * up}
    rows |= {f"{name}_back": row - ahead for name, row in rows.items()}
    return np.concatenate([rows[name] for name in ROWS])


def with_teeth(model: HeadModel) -> HeadModel:
    """FLAME with teeth behind its vertices and faces; a model of another topology as it is."""
    if (len(model.v_template), len(model.faces)) != FLAME:
        return model
    upper = np.array([name.startswith("upper") for name in ROWS]).repeat(COLUMN)
    weights = np.zeros((len(upper), 5), np.float32)
    weights[np.arange(len(upper)), np.where(upper, 1, 2)] = 1  # neck, jaw
    identity = (model.shapedirs[list(UPPER_LIP), :, :N_SHAPE] + model.shapedirs[list(LOWER_LIP), :, :N_SHAPE]) / 2
    directions = np.zeros((len(upper), *model.shapedirs.shape[1:]), np.float32)
    directions[:, :, :N_SHAPE] = np.tile(identity, (len(ROWS), 1, 1))
    ids = FLAME[0] + np.arange(len(upper))
    return replace(
        model,
        v_template=np.concatenate([model.v_template, teeth(model.v_template).astype(np.float32)]),
        faces=np.concatenate([model.faces, FLAME[0] + teeth_faces().astype(model.faces.dtype)]),
        shapedirs=np.concatenate([model.shapedirs, directions]),
        posedirs=np.concatenate([model.posedirs, np.zeros((len(upper), 3, 36), np.float32)]),
        joint_regressor=np.pad(model.joint_regressor, ((0, 0), (0, len(upper)))),
        weights=np.concatenate([model.weights, weights]),
        regions={**model.regions, "teeth": ids, "teeth_upper": ids[upper], "teeth_lower": ids[~upper]},
    )


def teeth_faces() -> Int[np.ndarray, "168 3"]:
    """The faces between the rows, numbered from the first vertex of the teeth."""
    faces = []
    for jaw, strips in STRIPS.items():
        first = {
            letter: COLUMN * ROWS.index(f"{jaw}_{name}")
            for letter, name in (("r", "root"), ("e", "edge"), ("R", "root_back"), ("E", "edge_back"))
        }
        for strip in strips:
            left, right = strip.split(" | ")
            for i in range(COLUMN - 1):
                for triangle in (left if i <= 6 else right).split(", "):
                    faces.append([first[corner[0]] + i + int(corner[1]) for corner in triangle.split()])
    return np.array(faces)


def add_teeth(path: GammaPath, neutral: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> GammaPath:
    """The path of a head's skin as that of the whole head: at its nodes, teeth are built anew."""
    if len(neutral) == len(path.neutral):
        return path
    grown = [teeth(path.neutral + u, path.neutral) - teeth(path.neutral) for u in path.displacements]
    changes = path.changes
    if changes is not None:
        changes = np.pad(changes, ((0, 0), (0, 0), (0, ADDED[0]), (0, 0)))  # only joints move them
    displacements = np.concatenate([path.displacements, np.array(grown, np.float32)], axis=1)
    return replace(path, displacements=displacements, faces=faces, neutral=neutral, changes=changes)


def without_teeth(path: GammaPath) -> GammaPath:
    """The path of the skin alone."""
    v, f = skin(len(path.neutral), len(path.faces))
    changes = None if path.changes is None else path.changes[:, :, :v]
    return replace(
        path, displacements=path.displacements[:, :v], faces=path.faces[:f], neutral=path.neutral[:v], changes=changes
    )


def _arch(lips: Float[np.ndarray, "v 3"]) -> tuple[float, Float[np.ndarray, "15 3"]]:
    """Mean distance of the lips' outer rings, and the curve between them."""
    upper, lower = lips[list(UPPER_LIP)], lips[list(LOWER_LIP)]
    return float(np.linalg.norm(upper - lower, axis=1).mean()), (upper + lower) / 2


def _length(curve: Float[np.ndarray, "n 3"]) -> float:
    return float(np.linalg.norm(np.diff(curve, axis=0), axis=1).sum())
