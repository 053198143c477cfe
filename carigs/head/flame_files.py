"""FLAME's files: the model, and what lies beside it: regions as vertices or as texture masks, and landmarks."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int

from carigs.errors import CarigsWarning, InputError
from carigs.head.region_geometry import FacialPoints, geometric_regions
from carigs.head.surface_points import SurfacePoints, points_of_faces
from carigs.head.teeth import FLAME_COUNTS, LOWER_LIP, UPPER_LIP
from carigs.readers.arrays import checked_array
from carigs.readers.file_names import LANDMARKS, MASKS, UV_MASKS, UV_MESH
from carigs.readers.mesh_files.obj import read_obj_uvs
from carigs.readers.npz import read_npz
from carigs.readers.pickles import read_pickle, read_pickled_npy

FULL_EMBEDDING = "full_lmk_faces_idx", "full_lmk_bary_coords"
EYEBALLS = np.arange(3931, 4477), np.arange(4477, 5023)
"""Vertices; the skin comes before them."""


def read_flame(file: Path) -> dict[str, Any]:
    """Read a FLAME pickle (2020, 2023 or 2023 Open), and regions and landmarks from the files beside it.

    Regions are taken from `FLAME_masks.pkl`, else from the texture masks `uv_masks.npz` with the texture coordinates
    of `head_template_mesh.obj`. Landmarks are the first 68 of `full_lmk_faces_idx` and
    `full_lmk_bary_coords` in `landmark_embedding_with_eyes.npy` or `landmark_embedding.npy`.

    Args:
        file: The .pkl file.

    Returns:
        The arrays by FLAME's names; regions are vertex indices under `mask_<region>`.

    Raises:
        InputError: If one of the files is not of its kind, or of another mesh.
    """
    arrays = read_pickle(file, "head model")
    folder = file.parent
    if (folder / MASKS).is_file() and file.name != MASKS:
        regions = read_pickle(folder / MASKS, "file of regions")
    elif (folder / UV_MASKS).is_file() and (folder / UV_MESH).is_file():
        regions = _uv_regions(folder / UV_MASKS, folder / UV_MESH)
    else:
        regions = {}
    arrays |= {f"mask_{name}": ids for name, ids in regions.items()}
    embedding = next((folder / name for name in LANDMARKS if (folder / name).is_file()), None)
    if embedding is not None and "f" in arrays:
        faces = checked_array(arrays, "f", (None, 3), np.int64, file=file)
        arrays |= _landmarks(embedding, faces).arrays("landmarks68")
    return arrays


def complete_flame(fields: dict[str, Any], file: Path) -> dict[str, Any]:
    """Add regions that FLAME's files do not have, found by the geometry of the template.

    `FLAME_masks.pkl` names no lids, brows or inside of the lips. Without a file of regions there is a warning, because
    the hairline is then an average one.

    Args:
        fields: Checked fields of a model (`carigs.head.model_arrays`).
        file: Where they come from, for the warning.

    Returns:
        The fields with the regions; the same if the model is not FLAME without teeth.
    """
    vertices, faces, regions = fields["v_template"], fields["faces"], fields["regions"]
    if (len(vertices), len(faces)) != FLAME_COUNTS:
        return fields
    upper, lower = vertices[list(UPPER_LIP)].astype(np.float64), vertices[list(LOWER_LIP)].astype(np.float64)
    line = (upper + lower) / 2
    right, left = sorted((line[0], line[-1]), key=lambda corner: corner[0])
    right_eyeball, left_eyeball = sorted(EYEBALLS, key=lambda ids: vertices[ids, 0].mean())
    points = FacialPoints(left_eyeball, right_eyeball, left, right, line[len(line) // 2])
    skin = np.arange(len(vertices)) < EYEBALLS[0][0]
    found = geometric_regions(vertices.astype(np.float64), faces, points, skin)
    if "scalp" not in regions:
        what = "hair, lips, lids and ears are found by geometry" if found else "hair and ears are not masked"
        problem = f"no {MASKS}, and no {UV_MASKS} with {UV_MESH}, beside it: {what}"
        # The absolute path: stages know the file by different paths, and a run shows equal warnings once.
        warnings.warn(f"{file.absolute()}: {problem}", CarigsWarning, stacklevel=2)
    return fields | {"regions": found | dict(regions)}


def _uv_regions(masks_file: Path, mesh_file: Path) -> dict[str, Int[np.ndarray, " _"]]:
    """Vertices of the faces whose texture centroid lies in a mask: row (1 - v) height, column u width."""
    faces, uvs = read_obj_uvs(mesh_file)
    if len(faces) != FLAME_COUNTS[1]:
        raise InputError(f"{len(faces)} faces, FLAME has {FLAME_COUNTS[1]}", file=mesh_file)
    u, v = uvs.mean(axis=1).T
    masks = read_npz(masks_file, "file of regions")
    regions = {}
    for name in masks:
        mask = checked_array(masks, name, (None, None), bool, file=masks_file)
        if mask.size == 0:
            raise InputError("holds no texels", file=masks_file, field=name)
        height, width = mask.shape
        rows = np.clip(((1 - v) * height).astype(int), 0, height - 1)
        columns = np.clip((u * width).astype(int), 0, width - 1)
        regions[name] = np.unique(faces[mask[rows, columns]])
    return regions


def _landmarks(file: Path, faces: Int[np.ndarray, "f 3"]) -> SurfacePoints:
    """The 68 landmarks; two of the eyes may follow."""
    embedding = read_pickled_npy(file, "landmark embedding")
    points = points_of_faces(embedding, FULL_EMBEDDING, faces, file)
    if len(points) < 68:
        raise InputError(f"{len(points)} landmarks; at least 68 are expected", file=file, field=FULL_EMBEDDING[0])
    return points[:68]
