"""The trained avatar and its file: surfels, rig, head model, head parameters over time, and the gamma path."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float32

from carigs.capture import Camera
from carigs.errors import InputError
from carigs.exaggeration import GammaPath
from carigs.files import writing
from carigs.head import HeadModel, HeadParameters
from carigs.head.model import N_SHAPE
from carigs.light.shading import Shading
from carigs.readers.npz import read_npz
from carigs.splat.render import SKINNINGS, render
from carigs.splat.rig.head_sequence import HeadSequence
from carigs.splat.surfels.surfels import ATTRIBUTES, Surfels, from_arrays, to_arrays

FORMAT = "carigs-avatar-2"
HEAD = ("posedirs", "joint_regressor", "weights", "parents")
"""Fields of `HeadModel` that the file holds as they are."""
POSE = ("translation", "rotation", "neck", "jaw", "eyes", "expression")
"""Fields of `HeadParameters` that the file holds for every timestep."""


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
        InputError: If the file is missing, broken, or of another format.
    """
    arrays = read_npz(file, "avatar")
    try:
        if str(arrays.get("format")) != FORMAT:
            raise InputError(f"not a {FORMAT} file", file=file, field="format")
        return _from_arrays(arrays, file)
    except KeyError as error:
        raise InputError("this array is missing", file=file, field=str(error.args[0])) from error
    except ValueError as error:
        raise InputError(f"not a readable avatar ({error})", file=file) from error


def _from_arrays(arrays: dict[str, np.ndarray], file: Path) -> Avatar:
    vertices, faces = arrays["head_vertices"], arrays["head_faces"]
    surfels = {name: arrays[f"surfel_{name}"] for name in (*ATTRIBUTES, "binding")}
    for name, value in surfels.items():
        if len(value) != len(surfels["binding"]):
            raise InputError(
                f"{len(value)} rows, expected {len(surfels['binding'])}", file=file, field=f"surfel_{name}"
            )
        if value.dtype.kind == "f" and not np.isfinite(value).all():
            row = int(np.argwhere(~np.isfinite(value))[0][0])
            raise InputError(f"row {row} is not finite", file=file, field=f"surfel_{name}")
    if len(surfels["binding"]) and not 0 <= surfels["binding"].min() <= surfels["binding"].max() < len(faces):
        raise InputError(f"faces must lie in 0..{len(faces) - 1}", file=file, field="surfel_binding")
    if str(arrays["rig"]) not in SKINNINGS:
        raise InputError(f"{arrays['rig']} is unknown; known: {', '.join(SKINNINGS)}", file=file, field="rig")
    shapedirs = np.zeros((len(vertices), 3, int(arrays["head_blendshapes"])), np.float32)
    shapedirs[:, :, arrays["head_columns"]] = arrays["head_expressions"]
    head = HeadModel(
        v_template=vertices,
        faces=faces,
        shapedirs=shapedirs,
        **{name: arrays[f"head_{name}"] for name in HEAD},
        regions={n.removeprefix("region_"): ids for n, ids in arrays.items() if n.startswith("region_")},
        expression_names=tuple(str(name) for name in arrays["head_expression_names"]),
    )
    parameters = {
        int(t): HeadParameters(**{name: arrays[f"pose_{name}"][i] for name in POSE})
        for i, t in enumerate(arrays["timesteps"])
    }
    path = GammaPath(
        levels=arrays["path_levels"], displacements=arrays["path_displacements"], faces=faces,
        neutral=arrays["path_neutral"], report={}, columns=arrays.get("path_columns"),
        changes=arrays.get("path_changes"),
    )  # fmt: skip
    sequence = HeadSequence(head, parameters, path)
    if "shading_light" in arrays:
        sequence.shading = Shading(**{f.name: arrays[f"shading_{f.name}"] for f in fields(Shading)})
    rotate_harmonics, background = bool(arrays["rotate_harmonics"]), float(arrays["background"])
    return Avatar(from_arrays(**surfels), sequence, str(arrays["rig"]), rotate_harmonics, background)
