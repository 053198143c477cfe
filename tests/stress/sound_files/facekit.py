"""A head in the layout of ICT-FaceKit Light."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from carigs.head import HeadModel
from carigs.head.ict_facekit import PARTS, VERTICES


def write_facekit(folder: Path, head: HeadModel, identities: int, expressions: Mapping[str, str]) -> np.ndarray:
    """Write a folder `FaceXModel` whose parts are filled with a head's vertices.

    Args:
        folder: Folder to write to.
        head: A head with eyeballs and landmarks, in metres.
        identities: Number of its identity blendshapes that are written.
        expressions: Its expression for each expression of the folder.

    Returns:
        The head's vertex at each vertex of the layout, -1 for parts that the head does not have.
    """
    sources = {
        "skin": np.flatnonzero(~head.vertex_region("left_eyeball", "right_eyeball")),
        **{name: head.regions[name] for name in ("left_eyeball", "right_eyeball")},
    }
    vertex = np.full(VERTICES, -1)
    for name, (first, last) in PARTS.items():
        vertex[first:last] = np.resize(sources[name], last - first)  # repeated, if the head has fewer
    held, first = np.unique(vertex, return_index=True)
    first_at = first[np.searchsorted(held, np.arange(len(head.v_template)))]
    faces = first_at[head.faces] + 1

    def write(name: str, displacement: np.ndarray) -> None:
        positions = np.zeros((VERTICES, 3))
        positions[vertex >= 0] = 100 * (head.v_template.astype(float) + displacement)[vertex[vertex >= 0]]
        lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in positions]
        lines += ["vt 0 0", *(f"f {a}/1 {b}/1 {c}/1" for a, b, c in faces), "f 24592/1 24593/1 24594/1 24595/1"]
        (folder / f"{name}.obj").write_text("\n".join(lines))

    write("generic_neutral_mesh", np.zeros(3))
    for i in range(identities):
        write(f"identity{i:03d}", head.identity_basis[:, :, i])
    for name, own in expressions.items():
        write(name, head.expression_basis[:, :, head.expression_names.index(own)])
    index = {
        "expressions": list(expressions),
        "idx_to_landmark_verts": first_at[head.landmarks68.corners[:, 0]].tolist(),
        "incompatibilities": [],
    }
    (folder / "vertex_indices.json").write_text(json.dumps(index))
    return vertex
