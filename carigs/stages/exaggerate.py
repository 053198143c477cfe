"""Stage `exaggerate`: the caricature path S_gamma of the subject's neutral head."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

from carigs.capture import Capture
from carigs.errors import InputError
from carigs.exaggeration import straight_path
from carigs.files import load_npz
from carigs.head import neutral, subject_gamma_path
from carigs.head.teeth import add_teeth, skin_counts
from carigs.settings import Exaggerate


def exaggerate(settings: Exaggerate, *, capture: Path, path: Path) -> None:
    """Compute the path of caricatures S_gamma, or read a caricature, and write the path.

    Args:
        settings: Settings of the stage.
        capture: Input: the index of the capture.
        path: Output: the exaggeration path (path.npz).

    Raises:
        SettingsError: For an unknown source, or a file without a path.
    """
    subject = Capture.load(capture)
    timesteps = dict.fromkeys(frame.timestep for frame in subject.frames)
    parameters = [subject.parameters(timestep) for timestep in timesteps]
    vertices, faces = neutral(subject.model, parameters[0]), subject.model.faces
    if settings.source == "poisson":
        solved = subject_gamma_path(subject.model, vertices, settings, parameters)
    else:
        file = Path(settings.file.replace("{gamma}", f"{settings.gamma:g}"))
        v, f = skin_counts(len(vertices), len(faces))
        displacement = read_displacement(file, vertices, v)
        n = len(displacement)
        solved = straight_path(vertices[:n], faces if n == len(vertices) else faces[:f], displacement, settings.gamma)
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
    if not file.is_file():
        raise InputError("no such caricature", file=file)
    if file.suffix == ".npz":
        displacement = load_npz(file, required=["delta"])["delta"].astype(np.float64)
    else:
        try:
            mesh = trimesh.load(file, process=False, maintain_order=True, force="mesh")
            displacement = np.asarray(mesh.vertices, np.float64) - neutral_vertices[: len(mesh.vertices)]
        except Exception as error:  # trimesh's readers raise errors of any type
            raise InputError(f"not a caricature of {len(neutral_vertices)} vertices ({error})", file=file) from error
    if displacement.shape not in (neutral_vertices.shape, (skin_vertices, 3)):
        raise InputError(f"shape {displacement.shape}, the head has {neutral_vertices.shape}", file=file, field="delta")
    if not np.isfinite(displacement).all():
        vertex = int(np.flatnonzero(~np.isfinite(displacement).all(axis=1))[0])
        raise InputError(f"vertex {vertex} is not finite", file=file, field="delta")
    return displacement
