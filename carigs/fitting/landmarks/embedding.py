"""What ties landmarks to a head model: a file that says where they lie on it.

| arrays | meaning | written by |
|---|---|---|
| `vertices` (p) | vertices | |
| `faces` (p), `barycentric` (p, 3) | points of triangles | |
| `lmk_face_idx`, `lmk_b_coords` | the same | FLAME: `flame_static_embedding.pkl`, without the jaw line |
| the same, and `landmark_indices` (p) | of the detector's landmarks these alone | `mediapipe_landmark_embedding.npz` |
| `static_lmk_faces_idx`, `static_lmk_bary_coords` | the same, without the jaw line | `landmark_embedding.npy` of DECA |
| `full_lmk_faces_idx`, `full_lmk_bary_coords` | the same, with the jaw line of a frontal view | the same file |

Detectors place the jaw line on the outline of the face: where that lies on the head changes with the view (`dynamic_*`
of FLAME's files). It takes no part in the fit if the embedding lacks it.

Without a file, 68 landmarks are those that the head model has itself, and 478 those of MediaPipe (`carigs.embedding`).
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int

from carigs.detection.mesh_indices import COUNT
from carigs.embedding import REGISTRATION, landmark_embedding
from carigs.errors import CarigsWarning, InputError, MeshError
from carigs.head import HeadModel, SurfacePoints
from carigs.head.surface_points import points_of_faces
from carigs.readers.arrays import checked_array
from carigs.readers.npz import read_npz
from carigs.readers.pickles import read_pickle, read_pickled_npy

JAW_LINE = 17
"""Landmarks of the jaw line: the first of the 68 of iBUG."""
ON_FACES = (
    ("faces", "barycentric"),
    ("lmk_face_idx", "lmk_b_coords"),
    ("static_lmk_faces_idx", "static_lmk_bary_coords"),
    ("full_lmk_faces_idx", "full_lmk_bary_coords"),
)
"""Names of indices of faces and of barycentric coordinates; the first pair that a file has counts."""
READERS = {".npz": read_npz, ".npy": read_pickled_npy, ".pkl": read_pickle}


def read_embedding(file: Path | None, model: HeadModel, count: int) -> tuple[SurfacePoints, Int[np.ndarray, " p"]]:
    """Where landmarks lie on a head model.

    Args:
        file: A file as described above; None for the model's own 68 landmarks, or MediaPipe's 478.
        model: The head model.
        count: Number of landmarks in an image.

    Returns:
        Points on the head, and the number of each among the landmarks of an image.

    Raises:
        InputError: If the file is missing or damaged, names faces or vertices that the model lacks, has coordinates
            that do not add up to 1, or another number of landmarks; if there is no file, and the landmarks are not the
            model's own and cannot be placed on it.

    Warns:
        CarigsWarning: MediaPipe's landmarks are placed on a head that the package does not know.
    """
    if file is None:
        return _own(model, count)
    if file.suffix not in READERS:
        raise InputError(f"an embedding is a file of the kinds {', '.join(READERS)}", file=file)
    arrays = READERS[file.suffix](file, "landmark embedding")
    points = _points(arrays, model, file)
    return points, _numbers(arrays, len(points), count, file)


def _own(model: HeadModel, count: int) -> tuple[SurfacePoints, Int[np.ndarray, " p"]]:
    """Landmarks that need no file."""
    if count == COUNT:
        try:
            embedding = landmark_embedding(model)
        except MeshError as error:
            problem = f"MediaPipe's landmarks find no place on it: {error}"
            raise InputError(problem, file="head model", remedy="give --embedding FILE") from error
        if embedding.source == REGISTRATION:
            what = f"{len(embedding.landmarks)} of {COUNT} landmarks were placed on the head model by registration"
            warnings.warn(CarigsWarning(f"{what}; carigs head embed writes them to a file"), stacklevel=3)
        return embedding.points(model), embedding.landmarks
    if model.landmarks68 is None or count != 68:
        own = "none" if model.landmarks68 is None else "68"
        problem = f"{count} landmarks; the head model has {own} of its own: give --embedding FILE"
        raise InputError(problem, file="landmarks", field="landmarks")
    return model.landmarks68, np.arange(68)


def _points(arrays: Mapping[str, Any], model: HeadModel, file: Path) -> SurfacePoints:
    if "vertices" in arrays:
        vertices = checked_array(arrays, "vertices", (None,), np.int64, below=len(model.v_template), file=file)
        return SurfacePoints.at_vertices(vertices)
    for names in ON_FACES:
        if names[0] in arrays:
            return points_of_faces(arrays, names, model.faces, file)
    known = ", ".join(("vertices", *(names[0] for names in ON_FACES)))
    raise InputError(f"holds none of {known}", file=file)


def _numbers(arrays: Mapping[str, Any], points: int, count: int, file: Path) -> Int[np.ndarray, " p"]:
    """The number of each point among the landmarks of an image."""
    if points == count:
        return np.arange(count)
    if "landmark_indices" in arrays:
        numbers = checked_array(arrays, "landmark_indices", (points,), np.int64, below=count, file=file)
        if len(np.unique(numbers)) < points:
            raise InputError("a number appears twice", file=file, field="landmark_indices")
        return numbers
    if points == count - JAW_LINE:
        return np.arange(JAW_LINE, count)
    raise InputError(f"{points} points for {count} landmarks", file=file)
