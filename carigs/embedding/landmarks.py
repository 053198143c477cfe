"""Where the 478 landmarks of MediaPipe lie on a head model: from a file of this package, or by registration."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import igl
import numpy as np
from jaxtyping import Bool, Float, Int

from carigs.detection.mesh_indices import COUNT
from carigs.embedding.anchors import RIM_WEIGHT, find_anchors, similarity_start
from carigs.embedding.canonical_face import canonical_face
from carigs.embedding.irises import iris_points
from carigs.embedding.outer_skin import outer_skin
from carigs.embedding.registration import Surface, closest_points, register
from carigs.errors import MeshError
from carigs.head import HeadModel, SurfacePoints
from carigs.mesh.triangle_mesh import face_normals, vertex_normals
from carigs.readers.npz import read_npz
from carigs.system.files import writing

SHIPPED = Path(__file__).with_name("shipped")
"""Embeddings of heads, each with the digest of the triangles that it belongs to."""
REGISTRATION = "registration"
FARTHEST = 0.1
"""Largest distance of a registered vertex from the head, in half distances between the eyes: 3 mm."""
EYE_JOINTS = ("left_eye", "right_eye")
BOUND = 0.5
"""Least weight of an eye's joint at the vertices of its eyeball."""


@dataclass(frozen=True)
class LandmarkEmbedding:
    """Landmarks on the triangles of a head model."""

    landmarks: Int[np.ndarray, " n"]
    """Numbers among MediaPipe's 478, in ascending order."""
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
        """Write the form that `carigs fit --embedding` reads, and others call `mediapipe_landmark_embedding.npz`.

        Args:
            file: The .npz file to write.
            **besides: Further arrays.
        """
        with writing(file) as part:
            np.savez_compressed(
                part,
                lmk_face_idx=self.faces,
                lmk_b_coords=self.barycentric,
                landmark_indices=self.landmarks,
                **besides,
            )


def landmark_embedding(model: HeadModel) -> LandmarkEmbedding:
    """Find where MediaPipe's landmarks lie on a head model.

    Args:
        model: The head model.

    Returns:
        The embedding that the package has for a head with these triangles; another head's is found by
        `register_landmarks`, in some seconds. `source` says which.

    Raises:
        MeshError: If the head cannot be registered.
    """
    digest = triangles_digest(model)
    for file in sorted(SHIPPED.glob("*.npz")):
        arrays = read_npz(file, "landmark embedding")
        if str(arrays["triangles_sha256"]) == digest:
            numbers, triangles = (arrays[name].astype(np.int64) for name in ("landmark_indices", "lmk_face_idx"))
            return LandmarkEmbedding(numbers, triangles, arrays["lmk_b_coords"].astype(np.float64), file.name)
    return register_landmarks(model)


def triangles_digest(model: HeadModel) -> str:
    """Digest of a model's triangles: heads that share them share their embeddings, whatever their shape.

    Args:
        model: The head model.

    Returns:
        SHA-256 in hexadecimal digits.
    """
    return hashlib.sha256(np.ascontiguousarray(model.faces, "<i4").tobytes()).hexdigest()


def register_landmarks(model: HeadModel) -> LandmarkEmbedding:
    """Register the canonical face of MediaPipe to the template of a head model.

    Args:
        model: The head model: it looks to +z, with +y up.

    Returns:
        The landmarks that have a trustworthy place: not far from the head, nor where the registered mesh folds. Those
        of the irises lie on the eyeballs, if the head has any.

    Raises:
        MeshError: If the model has neither eyes nor landmarks, or its mouth or an eye is closed and it has no
            landmarks.
    """
    vertices, faces = model.v_template.astype(np.float64), model.faces.astype(np.int64)
    landmarks68 = None if model.landmarks68 is None else model.landmarks68.interpolate(vertices)
    eyeballs = _eyeballs(model, "left_eye"), _eyeballs(model, "right_eye")
    eyes = _eye_centres(model, eyeballs, landmarks68)
    middle, unit = eyes.mean(axis=0), float(np.linalg.norm(eyes[0] - eyes[1])) / 2
    if not eyes[0, 0] - eyes[1, 0] > unit:
        raise MeshError("the left eye is not at +x beside the right one: a head looks to +z, with +y up")
    skin = outer_skin(vertices, faces, ~(eyeballs[0] | eyeballs[1]), eyes)
    anchors = find_anchors(skin, landmarks68)
    start = similarity_start(skin, anchors)
    skin_ids = np.flatnonzero(skin.faces)
    surface = Surface((vertices - middle) / unit, faces[skin_ids])
    anchors = anchors._replace(places=(anchors.places - middle) / unit)
    placed = register((start - middle) / unit, canonical_face().faces, surface, anchors)
    closest = closest_points(placed, surface)
    on_rim = np.isin(np.arange(len(placed)), anchors.vertices[anchors.weights == RIM_WEIGHT])
    folded = _folded(closest.position, closest.face, surface) & ~on_rim
    trusted = (closest.distance < FARTHEST) & ~folded
    found, corners = skin_ids[closest.face], surface.faces[closest.face]
    barycentric = igl.barycentric_coordinates(closest.position, *(surface.vertices[c] for c in corners.T))
    irises = iris_points(vertices, faces, eyeballs, eyes)
    landmarks = np.concatenate([np.flatnonzero(trusted), irises.landmarks])
    order = np.argsort(landmarks)
    weights = np.clip(np.concatenate([barycentric[trusted], irises.barycentric]), 0, 1)[order]
    return LandmarkEmbedding(
        landmarks[order],
        np.concatenate([found[trusted], irises.faces])[order],
        weights / weights.sum(axis=1, keepdims=True),
        REGISTRATION,
    )


def _eyeballs(model: HeadModel, joint: str) -> Bool[np.ndarray, " f"]:
    """Triangles of the eyeball of a side."""
    inside = model.vertex_region(f"{joint}ball")
    if joint in model.joint_names:
        inside = inside | (model.weights[:, model.joint_names.index(joint)] > BOUND)
    return inside[model.faces].all(axis=1)


def _eye_centres(
    model: HeadModel,
    eyeballs: tuple[Bool[np.ndarray, " f"], Bool[np.ndarray, " f"]],
    landmarks68: Float[np.ndarray, "68 3"] | None,
) -> Float[np.ndarray, "2 3"]:
    """Centres of the left and the right eye: joints, else the middles of the eyeballs, else of the landmarks."""
    if all(joint in model.joint_names for joint in EYE_JOINTS):
        return model.joint_template[[model.joint_names.index(joint) for joint in EYE_JOINTS]]
    if all(ball.any() for ball in eyeballs):
        parts = [model.v_template[np.unique(model.faces[ball])].astype(np.float64) for ball in eyeballs]
        return np.array([(part.min(axis=0) + part.max(axis=0)) / 2 for part in parts])
    if landmarks68 is not None:
        return np.array([landmarks68[42:48].mean(axis=0), landmarks68[36:42].mean(axis=0)])
    raise MeshError("the model has no joints left_eye and right_eye, no eyeballs and no landmarks68: add one of them")


def _folded(placed: Float[np.ndarray, "n 3"], on: Int[np.ndarray, " n"], surface: Surface) -> Bool[np.ndarray, " n"]:
    """Vertices around which the registered mesh faces against the surface beneath it."""
    own = vertex_normals(placed, canonical_face().faces)
    return np.einsum("nx,nx->n", own, face_normals(surface.vertices, surface.faces)[on]) < 0
