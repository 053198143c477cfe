"""Stage `exaggerate`: the caricature path S_gamma of the subject's neutral head."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from carigs.capture import Capture
from carigs.errors import InputError
from carigs.exaggeration import straight_path
from carigs.head import neutral, subject_gamma_path
from carigs.head.teeth import add_teeth, skin_counts
from carigs.mesh.deformation import check_deformation
from carigs.mesh.self_intersection import self_intersecting_faces
from carigs.readers.arrays import checked_array
from carigs.readers.mesh_files.meshes import read_mesh
from carigs.readers.npz import read_npz
from carigs.settings import Exaggerate


def exaggerate(settings: Exaggerate, *, capture: Path, path: Path) -> None:
    """Compute the path of caricatures S_gamma, or read a caricature, and write the path.

    Args:
        settings: Settings of the stage.
        capture: Input: the index of the capture.
        path: Output: the exaggeration path (path.npz).

    Raises:
        SettingsError: A setting does not fit the head, such as the name of a region.
        MeshError: If the head cannot be solved on, or moves absurdly far.

    Warns:
        CarigsWarning: The surface of the caricature folds or cuts itself (`carigs.mesh.deformation.MAX_DAMAGED`).
    """
    subject = Capture.load(capture)
    timesteps = dict.fromkeys(frame.timestep for frame in subject.frames)
    parameters = [subject.parameters(timestep) for timestep in timesteps]
    vertices, faces = neutral(subject.model, parameters[0]), subject.model.faces
    if settings.file is None:
        solved = subject_gamma_path(subject.model, vertices, settings, parameters)
    else:
        file = Path(settings.file.replace("{gamma}", f"{settings.gamma:g}"))
        v, f = skin_counts(len(vertices), len(faces))
        displacement = read_displacement(file, vertices, v)
        n = len(displacement)
        solved = straight_path(vertices[:n], faces if n == len(vertices) else faces[:f], displacement, settings.gamma)
    label = ", ".join([f"level {settings.gamma:g}", *(f"{name} {level:g}" for name, level in settings.regions.items())])
    cut_before = self_intersecting_faces(solved.neutral, solved.faces)
    check_deformation(solved.neutral, solved.displacement(settings.gamma), solved.faces, label, cut_before)
    add_teeth(solved, vertices, faces).save(path)


def read_displacement(file: Path, neutral_vertices: np.ndarray, skin_vertices: int) -> np.ndarray:
    """Read a caricature from an .npz file with the array `delta`, or from a sculpted mesh of the head.

    Args:
        file: The file.
        neutral_vertices: Vertices of the neutral head in metres.
        skin_vertices: Number of the skin's vertices, which come before the teeth.

    Returns:
        Displacement in metres of all vertices, or of the skin's.

    Raises:
        InputError: If the file is missing, cannot be read, or belongs to another mesh.
    """
    if file.suffix == ".npz":
        found, field = checked_array(read_npz(file, "caricature"), "delta", None, np.float64, file=file), "delta"
    else:
        found, field = np.asarray(read_mesh(file).vertices, np.float64), "vertices"
    if found.shape not in (neutral_vertices.shape, (skin_vertices, 3)):
        raise InputError(f"shape {found.shape}, the head has {neutral_vertices.shape}", file=file, field=field)
    return found if field == "delta" else found - neutral_vertices[: len(found)]
