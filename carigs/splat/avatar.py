"""The trained avatar and its file: surfels, rig, head model, head parameters over time, and the gamma path."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float32

from carigs.capture import Camera
from carigs.errors import InputError
from carigs.exaggeration import GammaPath
from carigs.files import writing
from carigs.head import HeadModel, HeadParameters, check_subject_path
from carigs.head.model import N_JOINTS, N_SHAPE
from carigs.head.posing import LARGEST_COORDINATE
from carigs.light.shading import shading_of
from carigs.readers.arrays import checked_array
from carigs.readers.npz import read_npz
from carigs.splat.render import SKINNINGS, render
from carigs.splat.rig.head_sequence import HeadSequence
from carigs.splat.surfels.surfels import Surfels, checked_surfels, to_arrays

FORMAT = "carigs-avatar-2"
HEAD = ("posedirs", "joint_regressor", "weights", "parents")
"""Fields of `HeadModel` that the file holds as they are."""
POSE = ("translation", "rotation", "neck", "jaw", "eyes", "expression")
"""Fields of `HeadParameters` that the file holds for every timestep."""
MAX_BLENDSHAPES = 2000
"""Most blendshapes of a head; FLAME has 400."""


@dataclass
class Avatar:
    """Everything that rendering needs, at any timestep of the capture and any level of the path.

    Attributes:
        surfels: The surfels in the frames of the triangles.
        sequence: Head model, parameters over time, gamma path and shading.
        skinning: One of `carigs.splat.render.SKINNINGS`.
        rotate_harmonics: Whether view-dependent colour turns with the head.
        background: Grey value behind the head, in [0, 1].
    """

    surfels: Surfels
    sequence: HeadSequence
    skinning: str = "jbs"
    rotate_harmonics: bool = True
    background: float = 1.0

    def render(
        self, timestep: int, level: float, camera: Camera, *, backend: str = "cpu"
    ) -> Float32[np.ndarray, "h w 3"]:
        """Render the head with a timestep's expression and pose at a level of exaggeration.

        Args:
            timestep: Timestep of the capture.
            level: Exaggeration, 0 for the natural head.
            camera: View.
            backend: Rasteriser, see `carigs.splat.rasterizer.rasterize.rasterize`.

        Returns:
            RGB in [0, 1].
        """
        with torch.no_grad():
            rendered = render(
                self.surfels, self.sequence.rig, self.sequence.motion(timestep, level), camera, skinning=self.skinning,
                rotate_harmonics=self.rotate_harmonics, background=self.background,
                shade=self.sequence.shade(timestep, level), backend=backend,
            )  # fmt: skip
        return rendered.image.numpy().clip(0, 1)


def save_avatar(file: Path, avatar: Avatar) -> None:
    """Write an avatar.

    Of the blendshapes only the expressions that move anything are stored. The gamma path is stored so that the file
    renders every level without other files. The stage `render` replaces it by the path that its rule
    names as input: this is the path of the training if both come from one study.

    Args:
        file: File to write (.npz).
        avatar: The avatar.
    """
    head, path, shading = avatar.sequence.head, avatar.sequence.path, avatar.sequence.shading
    used = N_SHAPE + np.flatnonzero(head.shapedirs[:, :, N_SHAPE:].any(axis=(0, 1)))
    timesteps = np.array(sorted(avatar.sequence.parameters))
    parameters = [avatar.sequence.parameters[t] for t in timesteps]
    with writing(file) as part:
        np.savez(
            part,
            format=FORMAT,
            rig=avatar.skinning,
            rotate_harmonics=avatar.rotate_harmonics,
            background=avatar.background,
            **{f"surfel_{name}": value for name, value in to_arrays(avatar.surfels).items()},
            head_vertices=head.v_template,
            head_faces=head.faces,
            head_columns=used,
            head_blendshapes=head.shapedirs.shape[2],
            head_expressions=head.shapedirs[:, :, used],
            **{f"head_{name}": getattr(head, name) for name in HEAD},
            head_expression_names=np.array(head.expression_names, dtype=str),
            **{f"region_{name}": ids for name, ids in head.regions.items()},
            timesteps=timesteps,
            **{f"pose_{name}": np.stack([getattr(p, name) for p in parameters]) for name in POSE},
            **({} if shading is None else {f"shading_{name}": value for name, value in asdict(shading).items()}),
            path_levels=path.levels,
            path_displacements=path.displacements,
            path_neutral=path.neutral,
            **({} if path.changes is None else {"path_columns": path.columns, "path_changes": path.changes}),
        )


def load_avatar(file: Path) -> Avatar:
    """Read an avatar.

    Args:
        file: File that `save_avatar` wrote.

    Returns:
        The avatar.

    Raises:
        InputError: If the file is missing, broken, or of another format, or if an array has another shape or type, or
            holds an index or number that is not possible; names the array.
    """
    arrays = read_npz(file, "avatar")
    if str(arrays.get("format")) != FORMAT:
        raise InputError(f"not a {FORMAT} file", file=file, field="format")
    head = _head(arrays, file)
    skinning = str(arrays.get("rig"))
    if skinning not in SKINNINGS:
        raise InputError(f"{skinning[:60]} is unknown; known: {', '.join(SKINNINGS)}", file=file, field="rig")
    surfels = checked_surfels(arrays, len(head.faces), file, "surfel_")
    path = GammaPath.from_arrays(arrays, head.faces, file, "path_")
    check_subject_path(path, head, file, "path_")
    sequence = HeadSequence(head, _parameters(arrays, head.shapedirs.shape[2] - N_SHAPE, file), path)
    if "shading_light" in arrays:
        sequence.shading = shading_of(arrays, len(head.faces), file, "shading_")
    background = float(checked_array(arrays, "background", (), np.float64, file=file))
    if not 0 <= background <= 1:
        raise InputError(f"{background:g} is not in [0, 1]", file=file, field="background")
    rotate_harmonics = bool(checked_array(arrays, "rotate_harmonics", (), bool, file=file))
    return Avatar(surfels, sequence, skinning, rotate_harmonics, background)


def _head(arrays: dict[str, np.ndarray], file: Path) -> HeadModel:
    def take(
        name: str, shape: tuple[int | None, ...], dtype: type = np.float32, below: int | None = None
    ) -> np.ndarray:
        return checked_array(arrays, name, shape, dtype, below=below, file=file)

    def refuse(is_bad: bool, field: str, problem: str) -> None:
        if is_bad:
            raise InputError(problem, file=file, field=field)

    vertices = take("head_vertices", (None, 3))
    v = len(vertices)
    faces = take("head_faces", (None, 3), np.int32, below=v)
    refuse(len(faces) == 0, "head_faces", "holds no faces")
    refuse(float(np.abs(vertices).max()) > LARGEST_COORDINATE, "head_vertices", "a coordinate is too large")
    blendshapes = int(take("head_blendshapes", (), np.int64))
    refuse(not N_SHAPE < blendshapes <= MAX_BLENDSHAPES, "head_blendshapes", f"{blendshapes} are impossible")
    columns = take("head_columns", (None,), np.int64, below=blendshapes)
    refuse(len(np.unique(columns)) < len(columns), "head_columns", "an index appears twice")
    shapedirs = np.zeros((v, 3, blendshapes), np.float32)
    shapedirs[:, :, columns] = take("head_expressions", (v, 3, len(columns)))
    parents = take("head_parents", (N_JOINTS,), np.int64)
    ordered = parents[0] == -1 and (0 <= parents[1:]).all() and (parents[1:] < np.arange(1, N_JOINTS)).all()
    refuse(not ordered, "head_parents", "each joint must come after its parent")
    names = arrays.get("head_expression_names", np.array([], str))
    refuse(names.ndim != 1 or names.dtype.kind not in "US", "head_expression_names", "expected a list of texts")
    return HeadModel(
        v_template=vertices,
        faces=faces,
        shapedirs=shapedirs,
        posedirs=take("head_posedirs", (v, 3, 36)),
        joint_regressor=take("head_joint_regressor", (N_JOINTS, v)),
        weights=take("head_weights", (v, N_JOINTS)),
        parents=parents,
        regions={
            name.removeprefix("region_"): take(name, (None,), np.int64, below=v)
            for name in arrays
            if name.startswith("region_")
        },
        expression_names=tuple(str(name) for name in names),
    )


def _parameters(arrays: dict[str, np.ndarray], expressions: int, file: Path) -> dict[int, HeadParameters]:
    timesteps = checked_array(arrays, "timesteps", (None,), np.int64, file=file)
    if len(timesteps) == 0 or len(np.unique(timesteps)) < len(timesteps) or timesteps.min() < 0:
        raise InputError("expected one or more different timesteps", file=file, field="timesteps")
    sizes = dict.fromkeys(POSE, 3) | {"eyes": 6, "expression": expressions}
    poses = {
        name: checked_array(arrays, f"pose_{name}", (len(timesteps), size), np.float64, file=file)
        for name, size in sizes.items()
    }
    return {int(t): HeadParameters(**{name: poses[name][i] for name in POSE}) for i, t in enumerate(timesteps)}
