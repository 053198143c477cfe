"""Renderings with one region exaggerated at a time (figure 4 of the paper)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from carigs.capture import Camera
from carigs.errors import SettingsError
from carigs.exaggeration import Exaggerator, GammaPath, straight_path
from carigs.head.teeth import add_teeth
from carigs.mesh.regions import find_region
from evaluation.figures.sheet import Image, write_sheet

if TYPE_CHECKING:
    from carigs.splat.avatar import Avatar

REGIONS = ("nose", "ears", "lips", "eye_region")
"""Regions that are drawn, if the head model has them."""


def local_edits(
    avatar: Avatar, exaggerator: Exaggerator, level: float, timestep: int, cameras: Sequence[Camera]
) -> dict[str, list[Image]]:
    """Render an avatar with each region exaggerated alone, while the rest of the head is held.

    Args:
        avatar: The avatar.
        exaggerator: Solver of the head's skin.
        level: Level of the region.
        timestep: Timestep of the expression.
        cameras: Views.

    Returns:
        Images by region, one per camera: `none` is the natural head, `all` the whole caricature.
    """
    whole = avatar.sequence.path
    images = {"none": [avatar.render(timestep, 0.0, camera) for camera in cameras]}
    for region in (name for name in REGIONS if _is_known(exaggerator, name)):
        path = _path_of_region(exaggerator, region, level, whole)
        edited = replace(avatar, sequence=replace(avatar.sequence, path=path))
        images[region] = [edited.render(timestep, level, camera) for camera in cameras]
    images["all"] = [avatar.render(timestep, level, camera) for camera in cameras]
    return images


def write_local_edits(
    file: Path, edits: Mapping[str, Sequence[Image]], cameras: Sequence[int], level: float, *, height: int
) -> None:
    """Draw the renderings of `local_edits`: a column for each region, a row for each camera.

    Args:
        file: PNG file to write.
        edits: Images by region, one per camera.
        cameras: Numbers of the cameras.
        level: Level of the regions.
        height: Height of each image in pixels.
    """
    images = [[column[i] for column in edits.values()] for i in range(len(cameras))]
    rows, columns = [f"camera {camera}" for camera in cameras], [name.replace("_", " ") for name in edits]
    title = f"One region at γ = {level:g}, the rest held"
    write_sheet(file, images, rows=rows, columns=columns, title=title, height=height)


def _path_of_region(exaggerator: Exaggerator, region: str, level: float, whole: GammaPath) -> GammaPath:
    displacement = exaggerator.local_edit(region).solve(level)
    skin = straight_path(whole.neutral[: len(displacement)], exaggerator.faces, displacement, level)
    return add_teeth(skin, whole.neutral, whole.faces)


def _is_known(exaggerator: Exaggerator, region: str) -> bool:
    try:
        find_region(exaggerator.regions.named, region)
    except SettingsError:
        return False
    return True
