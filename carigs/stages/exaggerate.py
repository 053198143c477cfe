"""Stage `exaggerate`: the caricature path S_gamma of the subject's neutral head."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

from carigs.capture import Capture
from carigs.errors import InputError, SettingsError
from carigs.head import caricature, neutral
from carigs.settings import Exaggerate
from carigs.surface import straight_path


def exaggerate(settings: Exaggerate, *, capture: Path, path: Path) -> None:
    """Solve, or read, the path and write `path` (path.npz)."""
    subject = Capture.load(capture)
    vertices = neutral(subject.model, subject.parameters(subject.frames[0].timestep))
    faces = subject.model.faces
    if settings.source == "poisson":
        caricature(subject.model, vertices, settings).save(path)
    elif settings.source == "file":
        if not settings.file:
            raise SettingsError("exaggerate.file must be set when exaggerate.source is file")
        file = Path(settings.file.replace("{gamma}", f"{settings.gamma:g}"))
        straight_path(vertices, faces, read_displacement(file, vertices), settings.gamma).save(path)
    else:
        raise SettingsError(f"exaggerate.source={settings.source} is unknown; choose poisson or file")


def read_displacement(file: Path, neutral_vertices: np.ndarray) -> np.ndarray:
    """The caricature's offset (V,3) in metres from an .npz with `delta`, or from a sculpted mesh of the head."""
    if not file.is_file():
        raise InputError("no such caricature", file=file)
    try:
        if file.suffix == ".npz":
            with np.load(file, allow_pickle=False) as archive:
                displacement = archive["delta"].astype(np.float64)
        else:
            mesh = trimesh.load(file, process=False, maintain_order=True, force="mesh")
            displacement = np.asarray(mesh.vertices, np.float64) - neutral_vertices
    except KeyError as error:
        raise InputError("this array is missing", file=file, field="delta") from error
    except Exception as error:  # trimesh's readers raise whatever their format's parser does
        raise InputError(f"not a caricature of {len(neutral_vertices)} vertices ({error})", file=file) from error
    if displacement.shape != neutral_vertices.shape:
        raise InputError(f"shape {displacement.shape}, the head has {neutral_vertices.shape}", file=file, field="delta")
    if not np.isfinite(displacement).all():
        vertex = int(np.flatnonzero(~np.isfinite(displacement).all(axis=1))[0])
        raise InputError(f"vertex {vertex} is not finite", file=file, field="delta")
    return displacement
