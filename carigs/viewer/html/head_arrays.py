"""The mesh for the page: template, rig, caricatures and clip, from which it poses the head by the formula of `pose`.

Before the joints turn, the vertices of timestep t at level g with regions j at levels g_j are

    template + natural(t) + sum_k l_k(g) change(t, k) + sum_j sum_k l_k(g_j) region(j, k)

with the Lagrange weights l_k of the nodes of the gamma path. `change` contains the displacement of the node and the
transfer of the timestep's blendshapes to it. The joints are a sum of the same form. So all of it is rows of numbers,
which are similar to each other: `low_rank`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from carigs.exaggeration import Caricature, GammaPath
from carigs.head.posing import unposed_frames
from carigs.splat.rig.head_sequence import HeadSequence
from carigs.splat.rig.solid_motion import Solid
from carigs.viewer.html.low_rank import low_rank
from carigs.viewer.html.packed_arrays import PackedArray, pack_exact, pack_integers, pack_steps

TOLERANCE = 2e-6
"""Root mean square error of the vertices in metres, before they are rounded."""
STEP = 2e-6
"""Metres."""
WEIGHT_STEP = SHARE_STEP = 1 / 65535


def head_arrays(
    sequence: HeadSequence, timesteps: Sequence[int], regions: Mapping[str, GammaPath]
) -> tuple[dict[str, Any], list[PackedArray]]:
    """Pack the mesh.

    Args:
        sequence: Head model, parameters over time, and gamma path.
        timesteps: The clip.
        regions: Path of each region that has a slider.

    Returns:
        Numbers for the header of the page, and the arrays.
    """
    head, path = sequence.head, sequence.path
    frames, joint_count = [sequence.parameters[t] for t in timesteps], len(head.parents)
    natural, joints, rotations = unposed_frames(head, frames)
    rows, joint_rows = [natural - head.v_template], [joints]
    for level in path.levels[1:].tolist():
        vertices, moved, _ = unposed_frames(head, frames, path.at(level))
        rows.append(vertices - natural)
        joint_rows.append(moved - joints)
    arrays = [
        pack_exact("template", head.v_template),
        pack_integers("faces", head.faces, delta=True),
        pack_steps("weights", head.weights, WEIGHT_STEP),
        pack_exact("rotations", rotations.reshape(len(frames), -1)),
        pack_exact("translations", np.array([parameters.translation for parameters in frames])),
        *_sums("clip", np.concatenate(rows), np.concatenate(joint_rows)),
    ]
    for i, region in enumerate(regions.values()):
        moved = [_joints_moved(sequence, displacement) for displacement in region.displacements[1:]]
        arrays += _sums(f"region{i}", region.displacements[1:], np.array(moved))
    if sequence.smooth is not None and len(sequence.smooth.faces):
        smooth = sequence.smooth
        arrays += [
            pack_integers("hair", smooth.faces, delta=True),
            pack_integers("anchors", np.array(smooth.anchors)),
            pack_steps("hair_share", smooth.share[smooth.faces], SHARE_STEP),
        ]
    if sequence.solids is not None:
        for name, solid in (("upper_jaw", Solid.UPPER_JAW), ("lower_jaw", Solid.LOWER_JAW), ("body", Solid.BODY)):
            if (mine := np.flatnonzero(sequence.solids.solids == solid)).size:
                arrays.append(pack_integers(name, mine, delta=True))
    if sequence.rig.keeps_size.any():
        arrays.append(pack_integers("kept", np.flatnonzero(sequence.rig.keeps_size), delta=True))
    header = {
        "vertices": len(head.v_template),
        "faces": len(head.faces),
        "parents": head.parents.tolist(),
        "joints": joint_count,
        "timesteps": list(timesteps),
        "levels": path.levels.tolist(),
        "regions": [{"name": name, "levels": region.levels.tolist()} for name, region in regions.items()],
        "hairGrows": bool(sequence.smooth is not None and sequence.smooth.grows),
    }
    return header, arrays


def _sums(name: str, vertices: np.ndarray, joints: np.ndarray) -> list[PackedArray]:
    """Rows of vertices (n, v, 3) and of joints (n, j, 3)."""
    found = low_rank(vertices.reshape(len(vertices), -1), TOLERANCE, STEP)
    return [
        pack_exact(f"{name}_coefficients", found.coefficients),
        pack_integers(f"{name}_basis", found.basis.T),
        pack_exact(f"{name}_joints", joints.reshape(len(joints), -1)),
    ]


def _joints_moved(sequence: HeadSequence, displacement: np.ndarray) -> np.ndarray:
    """How far a displacement of the neutral moves the joints."""
    head, frame = sequence.head, [next(iter(sequence.parameters.values()))]
    moved = unposed_frames(head, frame, Caricature(displacement.astype(np.float64)))[1]
    return moved[0] - unposed_frames(head, frame)[1][0]
