"""The trained avatar as a file: surfels, rig, head, what the person does over time, and the path of its caricature."""

from __future__ import annotations

import zipfile
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
from carigs.splat.render import RIGS, render
from carigs.splat.rig.head_sequence import HeadSequence
from carigs.splat.surfels.surfels import ATTRIBUTES, Surfels, from_arrays, to_arrays

FORMAT = "carigs-avatar-2"
POSE = ("translation", "rotation", "neck", "jaw", "eyes", "expression")


@dataclass
class Avatar:
    """Everything that rendering needs, at any timestep of the capture and any level of the path."""

    surfels: Surfels
    performance: HeadSequence
    rig: str = "jbs"
    """`jbs` or `jacobian`."""
    rotate_harmonics: bool = True
    background: float = 1.0
    """Grey value behind the head."""

    def render(
        self, timestep: int, level: float, camera: Camera, *, backend: str = "cpu"
    ) -> Float32[np.ndarray, "h w 3"]:
        """The head at a timestep's expression and pose, exaggerated to `level`; colours in [0, 1]."""
        performance = self.performance
        with torch.no_grad():
            drawing = render(
                self.surfels,
                performance.rig,
                performance.motion(timestep, level),
                camera,
                kind=self.rig,
                rotate_harmonics=self.rotate_harmonics,
                background=self.background,
                shade=performance.shade(timestep, level),
                backend=backend,
            )
        return drawing.image.numpy().clip(0, 1)


def save_avatar(file: Path, avatar: Avatar) -> None:
    """Write the .npz; of the expression directions only those that move anything."""
    head, path, shading = avatar.performance.head, avatar.performance.path, avatar.performance.shading
    used = N_SHAPE + np.flatnonzero(head.shapedirs[:, :, N_SHAPE:].any(axis=(0, 1)))
    timesteps = np.array(sorted(avatar.performance.parameters))
    poses = {
        f"pose_{name}": np.stack([getattr(avatar.performance.parameters[t], name) for t in timesteps]) for name in POSE
    }
    with writing(file) as part:
        np.savez(
            part,
            format=FORMAT,
            rig=avatar.rig,
            rotate_harmonics=avatar.rotate_harmonics,
            background=avatar.background,
            **{f"surfel_{name}": value for name, value in to_arrays(avatar.surfels).items()},
            head_vertices=head.v_template,
            head_faces=head.faces,
            head_columns=used,
            head_blendshapes=head.shapedirs.shape[2],
            head_expressions=head.shapedirs[:, :, used],
            head_posedirs=head.posedirs,
            head_joint_regressor=head.joint_regressor,
            head_weights=head.weights,
            head_parents=head.parents,
            head_expression_names=np.array(head.expression_names, dtype=str),
            **{f"region_{name}": ids for name, ids in head.regions.items()},
            timesteps=timesteps,
            **poses,
            **({} if shading is None else {f"shading_{name}": value for name, value in asdict(shading).items()}),
            path_levels=path.levels,
            path_displacements=path.displacements,
            path_neutral=path.neutral,
            **({} if path.changes is None else {"path_columns": path.columns, "path_changes": path.changes}),
        )


def load_avatar(file: Path) -> Avatar:
    """Read an avatar; raises `InputError` if the file is missing, broken, or of another format."""
    try:
        with np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except FileNotFoundError as error:
        raise InputError("no such avatar", file=file) from error
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(f"not a readable avatar ({error})", file=file) from error
    if str(arrays.get("format")) != FORMAT:
        raise InputError(f"not a {FORMAT} file", file=file, field="format")
    try:
        return _from_arrays(arrays, file)
    except KeyError as error:
        raise InputError("this array is missing", file=file, field=str(error.args[0])) from error


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
    if str(arrays["rig"]) not in RIGS:
        raise InputError(f"{arrays['rig']} is unknown; known: {', '.join(RIGS)}", file=file, field="rig")
    shapedirs = np.zeros((len(vertices), 3, int(arrays["head_blendshapes"])), np.float32)
    shapedirs[:, :, arrays["head_columns"]] = arrays["head_expressions"]
    head = HeadModel(
        v_template=vertices,
        faces=faces,
        shapedirs=shapedirs,
        posedirs=arrays["head_posedirs"],
        joint_regressor=arrays["head_joint_regressor"],
        weights=arrays["head_weights"],
        parents=arrays["head_parents"],
        regions={n.removeprefix("region_"): ids for n, ids in arrays.items() if n.startswith("region_")},
        expression_names=tuple(str(name) for name in arrays["head_expression_names"]),
    )
    parameters = {
        int(t): HeadParameters(**{name: arrays[f"pose_{name}"][i] for name in POSE})
        for i, t in enumerate(arrays["timesteps"])
    }
    path = GammaPath(
        levels=arrays["path_levels"],
        displacements=arrays["path_displacements"],
        faces=faces,
        neutral=arrays["path_neutral"],
        report={},
        columns=arrays.get("path_columns"),
        changes=arrays.get("path_changes"),
    )
    performance = HeadSequence(head, parameters, path)
    if "shading_light" in arrays:
        performance.shading = Shading(**{f.name: arrays[f"shading_{f.name}"] for f in fields(Shading)})
    return Avatar(
        from_arrays(**surfels),
        performance,
        str(arrays["rig"]),
        bool(arrays["rotate_harmonics"]),
        float(arrays["background"]),
    )
