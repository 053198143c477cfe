"""A tracked mesh per frame as a head model of its own: one joint, and principal components as expressions.

Rigid motion is given, or removed by Procrustes' method (Kabsch 1976); the singular value decomposition of what is left
gives the blendshapes. As many of them as there are other frames reproduce every frame. Of a long sequence, twice as
many components as are wanted are kept and updated by a few frames at once (Levey and Lindenbaum 2000).
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
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
BATCH = 64
"""Meshes in memory at once."""


class MeshTrack(NamedTuple):
    """A head model and its parameters in every frame."""

    model: HeadModel
    parameters: dict[int, HeadParameters]
    residual: float
    """Largest distance in metres between a vertex of a frame and of the posed model."""
    mean_residual: float
    """Root mean square of these distances."""


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
    vertices: Sequence[Float[np.ndarray, "v 3"]],
    faces: Int[np.ndarray, "f 3"],
    timesteps: Sequence[int],
    components: int = NUM_EXPRESSIONS,
    *,
    neutral: int = 0,
    world_from_head: Float[np.ndarray, "t 4 4"] | None = None,
    tolerance: float = 0.0,
) -> MeshTrack:
    """Find a head model and parameters that reproduce meshes.

    The meshes are read one after the other, three times, and only `BATCH` of them are in memory at once.

    Args:
        vertices: Points of each frame in metres: of the world, or, with `world_from_head`, of the head's own frame.
        faces: Triangles.
        timesteps: Number of each frame.
        components: Largest number of blendshapes.
        neutral: Position of the frame that is the neutral head.
        world_from_head: Rigid motion of each frame. None: by Procrustes' method, relative to the neutral head.
        tolerance: Root mean square in metres of the distances of vertices that may remain: no more blendshapes are
            made than it takes.

    Returns:
        The head model and its parameters.
    """
    template = vertices[neutral]
    if world_from_head is None:
        template = template - template.mean(axis=0)
    motions = [] if world_from_head is None else [(motion[:3, :3], motion[:3, 3]) for motion in world_from_head]
    count, v = len(vertices), len(template)

    def batches() -> Iterator[tuple[range, Float[np.ndarray, "n c"]]]:
        """Displacements of the head's own vertices, a few frames at once."""
        for start in range(0, count, BATCH):
            rows = []
            for i in range(start, min(start + BATCH, count)):
                points = vertices[i]
                if world_from_head is None:
                    if i == len(motions):
                        motions.append(rigid_alignment(template, points))
                    points = (points - motions[i][1]) @ motions[i][0]
                rows.append((points - template).ravel())
            yield range(start, start + len(rows)), np.stack(rows)

    kept, energy = np.zeros((0, 3 * v)), 0.0
    for _, rows in batches():
        energy += float((rows**2).sum())
        kept = np.concatenate([kept, rows])
        if len(kept) > 2 * components:  # turned, so that what is left out is what matters least
            turn = np.linalg.eigh(kept @ kept.T)[1][:, ::-1]
            kept = turn[:, : 2 * components].T @ kept
    _, s, basis = np.linalg.svd(kept, full_matrices=False)
    left = energy - np.cumsum(s**2)  # after one, two, ... components
    wanted = 1 + int((left > count * v * tolerance**2).sum()) if tolerance else components
    used = max(1, min(components, wanted, int((s > 1e-12 * s[0]).sum()))) if s[0] > 0 else 1
    basis, scale = basis[:used], s[:used] / np.sqrt(count)  # of one standard deviation, as FLAME's blendshapes
    model = HeadModel(
        v_template=template.astype(np.float32),
        faces=np.asarray(faces, np.int32),
        shapedirs=(scale[:, None] * basis).T.reshape(v, 3, used).astype(np.float32),
        posedirs=np.zeros((v, 3, 0), np.float32),
        joint_regressor=np.full((1, v), 1 / v, np.float32),  # the centroid
        weights=np.ones((v, 1), np.float32),
        parents=np.array([-1]),
        num_identity=0,
        joint_names=("root",),
    )
    parameters: dict[int, HeadParameters] = {}
    squares, largest = 0.0, 0.0
    for places, rows in batches():
        coefficients = (rows @ basis.T) / np.where(scale > 0, scale, 1)
        joints = template.mean(axis=0) + (coefficients * scale) @ basis.reshape(used, v, 3).mean(axis=1)
        for i, joint, expression in zip(places, joints, coefficients, strict=True):
            rotation, translation = motions[i]
            parameters[timesteps[i]] = HeadParameters(
                translation=translation + rotation @ joint - joint,  # the model turns the head around its joint
                rotation=Rotation.from_matrix(rotation).as_rotvec(),
                joints=np.zeros((0, 3)),
                shape=np.zeros(0),
                expression=expression,
            )
        posed = pose_frames(model, [parameters[timesteps[i]] for i in places])
        for i, points, row in zip(places, posed, rows, strict=True):
            rotation, translation = motions[i]
            world = (template + row.reshape(v, 3)) @ rotation.T + translation
            distances = np.linalg.norm(points - world, axis=1)
            squares, largest = squares + float((distances**2).sum()), max(largest, float(distances.max()))
    return MeshTrack(model, parameters, largest, math.sqrt(squares / (count * v)))
