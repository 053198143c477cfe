"""The trained avatar and its file: surfels, rig, head model, head parameters over time, and the gamma path."""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float32

from carigs.capture import Camera
from carigs.errors import InputError
from carigs.exaggeration import GammaPath
from carigs.hair.hair_shadow import hair_shadow_of
from carigs.head import check_subject_path
from carigs.light.shading import shading_of
from carigs.readers.arrays import checked_array, checked_text
from carigs.readers.formats import Format, check_npz_format
from carigs.readers.npz import read_npz
from carigs.splat.avatar_head import head_of, head_to_arrays, parameters_from_arrays, parameters_to_arrays
from carigs.splat.render import SKINNINGS, RenderedFrame, render, skin
from carigs.splat.rig.face_motion import FaceMotion
from carigs.splat.rig.head_sequence import HeadSequence
from carigs.splat.rig.skinning import SkinnedSurfels
from carigs.splat.rig.smooth_motion import smooth_motion_of
from carigs.splat.rig.solid_motion import solid_motion_of
from carigs.splat.surfels.ply import UNRENDERED
from carigs.splat.surfels.surfels import Surfels, checked_surfels, to_arrays
from carigs.system.files import writing

FORMAT = Format("carigs-avatar", 3, "train it again, or convert it again from what it was converted from")
EXPANSION = 20
"""Bytes of arrays for each byte of the file: `save_avatar` does not compress."""
MAX_SEEN = 500
"""Characters of `Avatar.seen`."""


@dataclass
class Avatar:
    """Everything that rendering needs, at any timestep of the capture and any level of the path.

    Attributes:
        surfels: The surfels in the frames of the triangles.
        sequence: Head model, parameters over time, gamma path and shading.
        skinning: One of `carigs.splat.render.SKINNINGS`.
        rotate_harmonics: Whether view-dependent colour turns with the head.
        background: Grey value behind the head, in [0, 1].
        unrendered: What a .ply file of another program held besides, see `carigs.splat.surfels.ply.UNRENDERED`.
        seen: From where training frames saw the head, and which parts of it none saw, in one line; empty if unknown.
    """

    surfels: Surfels
    sequence: HeadSequence
    skinning: str = "jbs"
    rotate_harmonics: bool = True
    background: float = 1.0
    unrendered: dict[str, np.ndarray] = field(default_factory=dict)
    seen: str = ""

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
        return self.render_frame(timestep, level, camera, backend=backend).image.numpy().clip(0, 1)

    def render_frame(self, timestep: int, level: float, camera: Camera, *, backend: str = "cpu") -> RenderedFrame:
        """Render the head as `render`, and keep what the image was made of.

        Args:
            timestep: Timestep of the capture.
            level: Exaggeration, 0 for the natural head.
            camera: View.
            backend: Rasteriser, see `carigs.splat.rasterizer.rasterize.rasterize`.

        Returns:
            The image, not clamped, and the surfels in world coordinates; without gradients.
        """
        motion, shade = self.sequence.motion(timestep, level), self.sequence.shade(timestep, level)
        return self.render_motion(motion, shade, camera, backend=backend)

    def render_motion(
        self, motion: FaceMotion, shade: Float32[np.ndarray, "f 3"] | None, camera: Camera, *, backend: str = "cpu"
    ) -> RenderedFrame:
        """Render the head in any pose.

        Args:
            motion: Motion of the triangles to the posed mesh.
            shade: Factor on the colours of every triangle; None for 1.
            camera: View.
            backend: Rasteriser, see `carigs.splat.rasterizer.rasterize.rasterize`.

        Returns:
            The image, not clamped, and the surfels in world coordinates; without gradients.
        """
        with torch.no_grad():
            return render(
                self.surfels, self.sequence.rig, motion, camera, skinning=self.skinning,
                rotate_harmonics=self.rotate_harmonics, background=self.background, shade=shade, backend=backend,
            )  # fmt: skip

    def skinned(self, timestep: int, level: float) -> SkinnedSurfels:
        """Carry the surfels to a timestep's expression and pose at a level of exaggeration.

        Args:
            timestep: Timestep of the capture.
            level: Exaggeration, 0 for the natural head.

        Returns:
            The surfels in world coordinates, without view directions and gradients.
        """
        with torch.no_grad():
            return skin(self.surfels, self.sequence.rig, self.sequence.motion(timestep, level), skinning=self.skinning)


def save_avatar(file: Path, avatar: Avatar) -> None:
    """Write an avatar.

    Of the blendshapes only the expressions that move anything are stored. The gamma path is stored so that the file
    renders every level without other files. The stage `render` replaces it by the path that its rule
    names as input: this is the path of the training if both come from one study.

    Args:
        file: File to write (.npz).
        avatar: The avatar.
    """
    path, shading, smooth = avatar.sequence.path, avatar.sequence.shading, avatar.sequence.smooth
    keeps_size, solids, shadow = avatar.sequence.rig.keeps_size, avatar.sequence.solids, avatar.sequence.hair_shadow
    with writing(file) as part:
        np.savez(
            part,
            format=str(FORMAT),
            rig=avatar.skinning,
            rotate_harmonics=avatar.rotate_harmonics,
            background=avatar.background,
            **{f"surfel_{name}": value for name, value in to_arrays(avatar.surfels).items()},
            **head_to_arrays(avatar.sequence.head),
            **parameters_to_arrays(avatar.sequence.parameters),
            **{f"unrendered_{name}": value for name, value in avatar.unrendered.items()},
            **({} if shading is None else {f"shading_{name}": value for name, value in asdict(shading).items()}),
            **({} if smooth is None else smooth.as_arrays()),
            **({} if solids is None else solids.as_arrays()),
            **({} if shadow is None else shadow.as_arrays()),
            **({"keeps_size": keeps_size} if keeps_size.any() else {}),
            **({"seen": avatar.seen} if avatar.seen else {}),
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
        InputError: If the file is missing, broken, or of another format or version, or if an array has another shape or
            type, holds an index or number that is not possible, or disagrees with another one; names the array.
    """
    arrays = read_npz(file, "avatar", expansion=EXPANSION)
    check_npz_format(arrays, FORMAT, file)
    head = head_of(arrays, file)
    skinning = checked_text(arrays, "rig", file=file)
    if skinning not in SKINNINGS:
        raise InputError(f"{skinning[:60]} is unknown; known: {', '.join(SKINNINGS)}", file=file, field="rig")
    surfels = checked_surfels(arrays, len(head.faces), file, "surfel_")
    path = GammaPath.from_arrays(arrays, head.faces, file, "path_")
    check_subject_path(path, head, file, "path_", neutral=head.v_template)
    sequence = HeadSequence(head, parameters_from_arrays(arrays, head, file), path)
    if not sequence.rig.inverse_edges.any():
        raise InputError("no triangle of the head has an area", file=file, field="head_v_template")
    if "keeps_size" in arrays:
        keeps_size = checked_array(arrays, "keeps_size", (len(head.faces),), bool, file=file)
        sequence.rig = sequence.rig.with_kept_size(keeps_size)
    if "hair_faces" in arrays:
        sequence.smooth = smooth_motion_of(arrays, sequence.rig, file)
    if "jaw_faces" in arrays:  # its name in files of versions without bodies
        arrays["solid_faces"] = arrays.pop("jaw_faces")
    if "solid_faces" in arrays:
        sequence.solids = solid_motion_of(arrays, sequence.rig, file)
    if any(name.startswith(("shading_", "hair_shadow_")) for name in arrays):  # one without the others is refused
        sequence.shading = shading_of(arrays, len(head.faces), file, "shading_")
        if "hair_shadow_points" in arrays:
            sequence.hair_shadow = hair_shadow_of(arrays, sequence.rig.vertices, file)
    background = float(checked_array(arrays, "background", (), np.float64, within=(0, 1), file=file))
    rotate_harmonics = bool(checked_array(arrays, "rotate_harmonics", (), bool, file=file))
    unrendered = {}
    for name, (shape, dtype) in UNRENDERED.items():
        if (key := f"unrendered_{name}") in arrays:
            below = 3 if name == "normal_axis" else None
            unrendered[name] = checked_array(arrays, key, (len(surfels), *shape), dtype, below=below, file=file)
    # One plain line, whatever the file says: pages and viewers show it, and viser's take markup with scripts.
    seen = checked_text(arrays, "seen", file=file) if "seen" in arrays else ""
    seen = " ".join(re.sub(r"[^\w,.:;-]", " ", seen[:MAX_SEEN], flags=re.ASCII).split())
    return Avatar(surfels, sequence, skinning, rotate_harmonics, background, unrendered, seen)
