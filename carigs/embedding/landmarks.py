"""Landmarks on the triangles of a head model."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from carigs.detection.mesh_indices import COUNT
from carigs.head import HeadModel, SurfacePoints
from carigs.system.files import writing

REGISTRATION = "registration"


@dataclass(frozen=True)
class LandmarkEmbedding:
    """Where MediaPipe's landmarks lie on a head model."""

    landmarks: Int[np.ndarray, " n"]
    """Numbers among the 478, in ascending order."""
    faces: Int[np.ndarray, " n"]
    """Triangle of each."""
    barycentric: Float[np.ndarray, "n 3"]
    """Its barycentric coordinates there."""
    source: str
    """Name of the file of this package, or `REGISTRATION`."""

    def points(self, model: HeadModel) -> SurfacePoints:
        """The landmarks as points of a head.

        Args:
            model: A model with the triangles that the embedding belongs to.

        Returns:
            The points.
        """
        return SurfacePoints(model.faces[self.faces].astype(np.int64), self.barycentric)

    @property
    def missing(self) -> Int[np.ndarray, " m"]:
        """Landmarks without a place on the head."""
        return np.setdiff1d(np.arange(COUNT), self.landmarks)

    def save(self, file: Path, **besides: np.ndarray) -> None:
        """Write the form that `carigs fit --embedding` reads, that of `mediapipe_landmark_embedding.npz`.

        Args:
            file: The .npz file to write.
            **besides: Further arrays.
        """
        arrays = {"lmk_face_idx": self.faces, "lmk_b_coords": self.barycentric, "landmark_indices": self.landmarks}
        with writing(file) as part:
            np.savez_compressed(part, **arrays, **besides)
