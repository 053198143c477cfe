"""Stage `exaggerate`: the caricature path S_gamma of the subject's neutral head."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

from carigs.capture import Capture
from carigs.errors import InputError
from carigs.exaggeration import straight_path
from carigs.head import neutral, subject_gamma_path
from carigs.head.teeth import add_teeth, skin_counts
from carigs.settings import Exaggerate


def exaggerate(settings: Exaggerate, *, capture: Path, path: Path) -> None:
    """Solve, or read, the path and write `path` (path.npz)."""
    subject = Capture.load(capture)
    timesteps = dict.fromkeys(frame.timestep for frame in subject.frames)
    parameters = [subject.parameters(timestep) for timestep in timesteps]
    vertices, faces = neutral(subject.model, parameters[0]), subject.model.faces
    if settings.source == "poisson":
        solved = subject_gamma_path(subject.model, vertices, settings, parameters)
    else:
        file = Path(settings.file.replace("{gamma}", f"{settings.gamma:g}"))
        v, f = skin_counts(len(vertices), len(faces))
        given = read_displacement(file, vertices, v)
        whole = len(given) == len(vertices)
        solved = straight_path(vertices[: len(given)], faces if whole else faces[:f], given, settings.gamma)
    add_teeth(solved, vertices, faces).save(path)


def read_displacement(file: Path, neutral_vertices: np.ndarray, skin_vertices: int) -> np.ndarray:
    """The caricature's offset (V,3) in metres from an .npz with `delta`, or from a sculpted mesh of the head.

    V counts all vertices, or the skin's, which come before the teeth.
    """
    if not file.is_file():
        raise InputError("no such caricature", file=file)
    try:
        if file.suffix == ".npz":
            with np.load(file, allow_pickle=False) as archive:
                displacement = archive["delta"].astype(np.float64)
        else:
            mesh = trimesh.load(file, process=False, maintain_order=True, force="mesh")
            displacement = np.asarray(mesh.vertices, np.float64)
            displacement = displacement - neutral_vertices[: len(displacement)]
    except KeyError as error:
        raise InputError("this array is missing", file=file, field="delta") from error
    except Exception as error:  # trimesh's readers raise whatever their format's parser does
        raise InputError(f"not a caricature of {len(neutral_vertices)} vertices ({error})", file=file) from error
    if displacement.shape not in (neutral_vertices.shape, (skin_vertices, 3)):
        raise InputError(f"shape {displacement.shape}, the head has {neutral_vertices.shape}", file=file, field="delta")
    if not np.isfinite(displacement).all():
        vertex = int(np.flatnonzero(~np.isfinite(displacement).all(axis=1))[0])
        raise InputError(f"vertex {vertex} is not finite", file=file, field="delta")
    return displacement
