"""Triangles inside the mouth that move as two solids: its roof with the skull, its floor with the jaw.

Rays from a point behind the lips find the roof and the floor of the bag that most head models have there. Near the lips
this bag stretches with them. So the half of the triangles of each side is kept that a rigid motion fits best at all
timesteps (least trimmed squares: Rousseeuw 1984).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int, UInt8

from carigs.head import HeadModel
from carigs.mesh.ray_caster import RayCaster
from carigs.mesh.rigid_alignment import rigid_alignment
from carigs.mesh.triangle_mesh import face_normals, size
from carigs.mouth.jaw import Jaw
from carigs.mouth.lip_line import LipLine

ORIGIN, REACH = 0.35, 1.2
"""Depth of the rays' origin behind the lips, and their length, in widths of the mouth."""
RAYS, STEEPNESS = 1500, 0.4
"""Number of rays in all directions, and the least sine of their elevation that counts as up or down."""
TRIMMED, ROUNDS = 0.5, 5
"""Share of the triangles that are kept, and number of times they are chosen and fitted again."""
LEAST_TRIANGLES, TOLERANCE = 6, 0.06
"""Fewest triangles of a side, and the largest rms distance of their centres from a rigid motion in widths of the
mouth."""

TEETH = {Jaw.UPPER: "teeth_upper", Jaw.LOWER: "teeth_lower"}
"""Regions of a model with teeth."""


def has_teeth(model: HeadModel) -> bool:
    """Whether a model has teeth, such as FLAME.

    Args:
        model: Head model.

    Returns:
        Whether the regions `TEETH` have triangles.
    """
    return all(model.face_region(region).any() for region in TEETH.values())


def find_jaws(
    model: HeadModel, neutral: Float[np.ndarray, "v 3"], posed: Sequence[Float[np.ndarray, "v 3"]], line: LipLine
) -> UInt8[np.ndarray, " f"] | None:
    """Find the triangles that carry the upper and the lower teeth.

    Args:
        model: Head model.
        neutral: Vertices of the subject's neutral head in metres.
        posed: The head at several timesteps.
        line: Where the lips meet.

    Returns:
        A `Jaw` for every triangle: the model's teeth if it has some; None if a side is not found or does not move as a
        solid, as where the model has no inside of the mouth.
    """
    jaws = np.zeros(len(model.faces), np.uint8)
    if has_teeth(model):
        for jaw, region in TEETH.items():
            jaws[model.face_region(region)] = jaw
        return jaws
    hit, elevation = _seen_from_within(neutral, model.faces, line)
    for jaw, side in ((Jaw.UPPER, elevation > STEEPNESS), (Jaw.LOWER, elevation < -STEEPNESS)):
        found = _solid_part(np.unique(hit[side]), model.faces, neutral, posed)
        if found is None or found[1] > TOLERANCE * line.width:
            return None
        jaws[found[0]] = jaw
    return jaws


def _seen_from_within(
    neutral: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], line: LipLine
) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Triangles whose front a point in the mouth sees, one per ray, and the sine of the ray's elevation."""
    unit = size(neutral, faces)
    origin = (line.middle - [0, 0, ORIGIN * line.width]) / unit
    # Directions of a spherical Fibonacci lattice (Gonzalez 2010).
    up = 1 - (2 * np.arange(RAYS) + 1) / RAYS
    angle = np.pi * (1 + 5**0.5) * np.arange(RAYS)
    across = np.sqrt(1 - up**2)
    directions = np.column_stack([across * np.cos(angle), up, across * np.sin(angle)])
    caster = RayCaster(np.asarray(neutral, np.float64), faces)
    face, _, _ = caster.first_hit(np.tile(origin, (RAYS, 1)), directions, REACH * line.width / unit)
    facing = np.einsum("nc,nc->n", face_normals(neutral, faces)[face], directions) < 0
    seen = (face >= 0) & facing
    return face[seen].astype(np.int64), up[seen]


def _solid_part(
    candidates: Int[np.ndarray, " n"],
    faces: Int[np.ndarray, "f 3"],
    neutral: Float[np.ndarray, "v 3"],
    posed: Sequence[Float[np.ndarray, "v 3"]],
) -> tuple[Int[np.ndarray, " k"], float] | None:
    """The triangles that move most like one solid, and the rms distance of their centres from its motion."""
    if len(candidates) < 2 * LEAST_TRIANGLES:
        return None
    corners = faces[candidates]
    source, targets = neutral[corners].mean(axis=1), [vertices[corners].mean(axis=1) for vertices in posed]
    kept, squared = np.ones(len(candidates)), np.zeros(len(candidates))
    for _ in range(ROUNDS):
        squared = np.zeros(len(candidates))
        for target in targets:
            rotation, translation = rigid_alignment(source, target, kept)
            squared += ((source @ rotation.T + translation - target) ** 2).sum(axis=1)
        kept = (squared <= np.quantile(squared, TRIMMED)).astype(np.float64)
    return candidates[kept > 0], float(np.sqrt(squared[kept > 0].mean() / len(targets)))
