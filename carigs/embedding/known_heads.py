"""Heads whose landmarks are in files of this package: the procedural head, and ICT-FaceKit Light."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from carigs.embedding.head_registration import register_landmarks
from carigs.embedding.landmarks import LandmarkEmbedding
from carigs.head import HeadModel
from carigs.readers.npz import read_npz

SHIPPED = Path(__file__).with_name("shipped")
"""Embeddings, each with the digest of the triangles that it belongs to."""


def landmark_embedding(model: HeadModel) -> LandmarkEmbedding:
    """Find where MediaPipe's landmarks lie on a head model.

    Args:
        model: The head model.

    Returns:
        The embedding that the package has for a head with these triangles; another head's is found by
        `register_landmarks`, in about a second. `source` says which.

    Raises:
        MeshError: If the head cannot be registered.
    """
    digest = triangles_digest(model)
    for file in sorted(SHIPPED.glob("*.npz")):
        arrays = read_npz(file, "landmark embedding")
        if str(arrays["triangles_sha256"]) == digest:
            landmarks, faces = (arrays[name].astype(np.int64) for name in ("landmark_indices", "lmk_face_idx"))
            return LandmarkEmbedding(landmarks, faces, arrays["lmk_b_coords"].astype(np.float64), file.name)
    return register_landmarks(model)


def ship(model: HeadModel, name: str) -> None:
    """Register a head, and write the file of this package that makes it known.

    Args:
        model: The head model.
        name: Name of the file, without suffix.
    """
    found = register_landmarks(model)
    small = LandmarkEmbedding(
        found.landmarks.astype(np.uint16), found.faces.astype(np.uint32), found.barycentric.astype(np.float32), name
    )
    small.save(SHIPPED / f"{name}.npz", triangles_sha256=np.array(triangles_digest(model)))


def triangles_digest(model: HeadModel) -> str:
    """Digest of a model's triangles: heads that share them share their embeddings, whatever their shape.

    Args:
        model: The head model.

    Returns:
        SHA-256 in hexadecimal digits.
    """
    return hashlib.sha256(np.ascontiguousarray(model.faces, "<i4").tobytes()).hexdigest()
