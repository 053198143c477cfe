"""A tracked mesh per frame as a head model of its own: one joint, and principal components as expressions.

Rigid motion is removed by Procrustes' method (Kabsch 1976); the singular value decomposition of what is left gives the
blendshapes. As many of them as there are other frames reproduce every frame.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from carigs.capture.calibration.camera_checks import FARTHEST
from carigs.capture.importers.images import stated_timestep
from carigs.errors import InputError
from carigs.head import HeadModel, HeadParameters, pose_frames
from carigs.mesh.rigid_alignment import rigid_alignment
from carigs.readers.folders import listed
from carigs.readers.mesh_files.meshes import read_polygons
from carigs.readers.mesh_files.polygons import triangulate_polygons

NUM_EXPRESSIONS = 100
"""Largest number of blendshapes, as of FLAME."""


class MeshTrack(NamedTuple):
    """A head model and its parameters in every frame."""

    model: HeadModel
    parameters: dict[int, HeadParameters]
    residual: float
    """Largest distance in metres between a vertex of a frame and of the posed model."""


def read_mesh_sequence(folder: Path, metres_per_unit: float = 1.0) -> MeshTrack:
    """Read one mesh per timestep.

    Args:
        folder: OBJ or PLY files of one topology; the last number of a name is its timestep. World axes: y up, the face
            towards +z. The first frame is the neutral head.
        metres_per_unit: Size of the unit of the meshes.

    Returns:
        The head model and its parameters.

    Raises:
        InputError: If there are no meshes, or the topology changes.
    """
    files = {}
    for file in (file for file in listed(folder) if file.suffix.lower() in (".obj", ".ply")):
        numbers = re.findall(r"\d+", file.stem)
        timestep = stated_timestep(numbers[-1]) if numbers else None
        if timestep is None or timestep in files:
            raise InputError("the names of meshes end with different numbers, their timesteps", file=file)
        files[timestep] = file
    if not files:
        raise InputError("holds no .obj or .ply meshes", file=folder)
    meshes = {t: read_polygons(file) for t, file in sorted(files.items())}
    first_timestep, first = next(iter(meshes.items()))
    for t, mesh in meshes.items():
        same_faces = np.array_equal(mesh.lengths, first.lengths) and np.array_equal(mesh.corners, first.corners)
        if not same_faces or len(mesh.vertices) != len(first.vertices):
            raise InputError("has other faces than the first mesh; one topology is needed", file=files[t])
        far = np.flatnonzero(~(np.abs(mesh.vertices) * metres_per_unit < FARTHEST).all(axis=1))  # NaN as well
        if far.size:  # also one that no face names: all of them make the mean and the principal components
            problem = f"vertex {far[0]} is not finite, or {FARTHEST:g} m or more from the origin; see --metres-per-unit"
            raise InputError(problem, file=files[t], field="vertices")
    vertices = metres_per_unit * np.stack([mesh.vertices for mesh in meshes.values()])
    faces = triangulate_polygons(first, files[first_timestep])  # as in all frames, however polygons bend
    return track_meshes(vertices, faces.astype(np.int32), list(meshes))


def track_meshes(
    vertices: Float[np.ndarray, "t v 3"], faces: np.ndarray, timesteps: list[int], components: int = NUM_EXPRESSIONS
) -> MeshTrack:
    """Find a head model and parameters that reproduce meshes.

    Args:
        vertices: World points in metres.
        faces: Triangles.
        timesteps: Number of each frame.
        components: Largest number of blendshapes.

    Returns:
        The head model and its parameters.
    """
    centre = vertices[0].mean(axis=0)
    template = vertices[0] - centre
    aligned, motions = np.empty_like(vertices), []
    for i, points in enumerate(vertices):
        rotation, translation = rigid_alignment(template, points)
        aligned[i] = (points - translation) @ rotation
        motions.append((Rotation.from_matrix(rotation).as_rotvec(), translation))
    count, v = len(vertices), vertices.shape[1]
    u, s, basis = np.linalg.svd((aligned - template).reshape(count, -1), full_matrices=False)
    used = max(1, min(components, int((s > 1e-12 * s[0]).sum()))) if s[0] > 0 else 1
    scale = s[:used] / np.sqrt(count)  # blendshapes have the size of one standard deviation, as those of FLAME
    coefficients = u[:, :used] * np.sqrt(count)
    model = HeadModel(
        v_template=template.astype(np.float32),
        faces=np.asarray(faces, np.int32),
        shapedirs=(scale[:, None] * basis[:used]).T.reshape(v, 3, used).astype(np.float32),
        posedirs=np.zeros((v, 3, 0), np.float32),
        joint_regressor=np.full((1, v), 1 / v, np.float32),  # the centroid, which no blendshape moves
        weights=np.ones((v, 1), np.float32),
        parents=np.array([-1]),
        num_identity=0,
        joint_names=("root",),
    )
    parameters = {
        t: HeadParameters(
            translation=translation, rotation=rotation, joints=np.zeros((0, 3)), shape=np.zeros(0), expression=c
        )
        for t, (rotation, translation), c in zip(timesteps, motions, coefficients, strict=True)
    }
    posed = pose_frames(model, list(parameters.values()))
    return MeshTrack(model, parameters, float(np.linalg.norm(posed - vertices, axis=2).max()))
