"""Files that the page asks for: pictures, clips, meshes and surfels, all in one folder."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32

from carigs.capture import Camera
from carigs.capture.images import write_png
from carigs.errors import SettingsError
from carigs.exaggeration.gamma_path import straight_path
from carigs.library import orbit
from carigs.library.animated_export import write_clips
from carigs.library.clips import write_clip
from carigs.splat.formats.animated_head import HeadClip
from carigs.splat.formats.baked_colours import baked_colours
from carigs.splat.formats.gltf_splats import write_gltf_splats
from carigs.splat.formats.head_meshes import level_vertices, posed_path, write_mesh, write_morph_targets
from carigs.splat.formats.splat_files import write_2dgs_ply, write_3dgs_ply, write_splat
from carigs.viewer.exact_mode import exact_image
from carigs.viewer.html.page import write_html
from carigs.viewer.scene import HeadScene
from carigs.viewer.state import Values, timestep_of

NAME = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9._-]{0,63}")
"""Names of files without their suffix: no separators, no leading dot, nothing that a shell or a browser interprets."""
MAX_FILES = 500
"""Files that one server writes."""
FPS, SWEEP_IMAGES, ORBIT_IMAGES = 24.0, 72, 96
"""Images per second, and numbers of images, of clips."""


class Export(NamedTuple):
    """What to write."""

    format: str
    """One of `FORMATS`."""
    name: str
    """Name of the file without its suffix."""
    values: Values
    """Values of the controls."""
    camera: Camera
    """View of the client, in the size of pictures and clips."""


class ExportFolder:
    """The folder that exports are written to, and to no other place.

    Attributes:
        folder: The folder; it is made with the first file.
    """

    def __init__(self, folder: Path) -> None:
        """Take a folder.

        Args:
            folder: The folder.
        """
        self.folder = folder
        self._lock = threading.Lock()
        self._written = 0

    def new_file(self, name: str, suffix: str) -> Path:
        """A name that no file has yet.

        Args:
            name: Wanted name without suffix.
            suffix: The suffix, such as ".png".

        Returns:
            The file: `name`, or `name-2`, `name-3` and so on.

        Raises:
            SettingsError: If the name is not plain, or `MAX_FILES` were written.
        """
        if not isinstance(name, str) or not NAME.fullmatch(name):
            raise SettingsError("the name of an export has up to 64 letters, digits, dots, - and _, and no leading dot")
        with self._lock:
            if self._written >= MAX_FILES:
                raise SettingsError(f"{MAX_FILES} files were exported; start the viewer again for more")
            self._written += 1
            for number in range(1, MAX_FILES + 2):
                file = self.folder / f"{name}{'' if number == 1 else f'-{number}'}{suffix}"
                if not file.exists() and not file.is_symlink():
                    return file
        raise SettingsError(f"there are {MAX_FILES} files named {name}")


def _write_picture(file: Path, scene: HeadScene, export: Export, images: Callable) -> None:
    for image in images(_frames(scene, export.camera, [export.values])):
        file.parent.mkdir(parents=True, exist_ok=True)
        write_png(file, image)


def _write_sweep(file: Path, scene: HeadScene, export: Export, images: Callable) -> None:
    top = export.values["level"] or scene.avatar.gamma
    levels = top * (0.5 - 0.5 * np.cos(2 * np.pi * np.arange(SWEEP_IMAGES) / SWEEP_IMAGES))
    values = [{**export.values, "level": float(level)} for level in levels]
    write_clip(file, images(_frames(scene, export.camera, values)), FPS)


def _write_turntable(file: Path, scene: HeadScene, export: Export, images: Callable) -> None:
    size = export.camera.height, export.camera.width
    surfels = (_image(scene, export.values, camera) for camera in orbit(scene.avatar, ORBIT_IMAGES, size=size))
    write_clip(file, images(surfels), FPS)


def _write_sequence(file: Path, scene: HeadScene, export: Export, images: Callable) -> None:
    name, count, fps = "frame", len(scene.avatar.timesteps), FPS
    if number := int(export.values.get("motion", 0)):
        name, count, fps = "motion_frame", len(scene.drives[number - 1].parameters), scene.drives[number - 1].fps
    values = [{**export.values, name: float(frame)} for frame in range(count)]
    write_clip(file, images(_frames(scene, export.camera, values)), fps)


def _write_mesh(file: Path, scene: HeadScene, export: Export, images: Callable) -> None:
    vertices, faces = scene.vertices(export.values), scene.avatar.avatar.sequence.head.faces
    colours = baked_colours(scene.avatar.avatar, vertices)
    write_mesh(file, straight_path(vertices, faces, np.zeros_like(vertices), 1.0), 0.0, colours)


def _write_morph_targets(file: Path, scene: HeadScene, export: Export, images: Callable) -> None:
    avatar, level = scene.avatar.avatar, export.values["level"]
    path = posed_path(avatar.sequence, timestep_of(scene.avatar, export.values))
    write_morph_targets(file, path, level, baked_colours(avatar, level_vertices(path, level)))


def _write_animated(file: Path, scene: HeadScene, export: Export, images: Callable) -> None:
    clips = {drive.name: HeadClip(drive.fps, drive.parameters) for drive in scene.drives}
    write_clips(scene.avatar, file, export.values["level"], clips)


def _write_page(file: Path, scene: HeadScene, export: Export, images: Callable) -> None:
    write_html(scene.avatar, file, level=export.values["level"])


def _surfel_writer(write: Callable) -> Callable:
    def writer(file: Path, scene: HeadScene, export: Export, images: Callable) -> None:
        write(file, scene.posed_head(export.values).surfels())

    return writer


FORMATS: dict[str, tuple[str, Callable]] = {
    "picture (.png)": (".png", _write_picture),
    "gamma sweep (.mp4)": (".mp4", _write_sweep),
    "gamma sweep (.webp)": (".webp", _write_sweep),
    "turntable (.mp4)": (".mp4", _write_turntable),
    "turntable (.webp)": (".webp", _write_turntable),
    "sequence (.mp4)": (".mp4", _write_sequence),
    "mesh (.obj)": (".obj", _write_mesh),
    "mesh (.ply)": (".ply", _write_mesh),
    "mesh (.glb)": (".glb", _write_mesh),
    "mesh, morph targets of levels (.glb)": (".glb", _write_morph_targets),
    "mesh, animated (.glb)": (".glb", _write_animated),
    "page (.html)": (".html", _write_page),
    "surfels, 3DGS (.ply)": (".ply", _surfel_writer(write_3dgs_ply)),
    "surfels, 2DGS (.ply)": (".ply", _surfel_writer(write_2dgs_ply)),
    "surfels (.splat)": (".splat", _surfel_writer(write_splat)),
    "surfels (.glb)": (".glb", _surfel_writer(write_gltf_splats)),
}
"""Suffix and writer of each format."""


def write_export(
    folder: ExportFolder,
    scene: HeadScene,
    export: Export,
    lock: AbstractContextManager,
    on_image: Callable[[int], None] = lambda count: None,
) -> Path:
    """Write a file.

    Args:
        folder: Where.
        scene: The avatar.
        export: What.
        lock: Held while an image is rendered, and released in between.
        on_image: Called with the number of images so far.

    Returns:
        The file.

    Raises:
        SettingsError: If the format or the name is not possible.
        InputError: If the file cannot be written.
    """
    if export.format not in FORMATS:
        raise SettingsError("there is no such format of exports")
    suffix, write = FORMATS[export.format]
    file = folder.new_file(export.name, suffix)
    if "mesh" in export.format or "surfels" in export.format or "page" in export.format:
        with lock:
            write(file, scene, export, iter)
    else:
        write(file, scene, export, lambda images: _one_at_a_time(images, lock, on_image))
    return file


def _one_at_a_time(
    images: Iterable[Float32[np.ndarray, "h w 3"]], lock: AbstractContextManager, on_image: Callable
) -> Iterator[Float32[np.ndarray, "h w 3"]]:
    images, count = iter(images), 0
    while True:
        with lock:
            image = next(images, None)
        if image is None:
            return
        count += 1
        on_image(count)
        yield image


def _frames(scene: HeadScene, camera: Camera, values: Iterable[Values]) -> Iterator[Float32[np.ndarray, "h w 3"]]:
    for frame in values:
        yield _image(scene, frame, camera)


def _image(scene: HeadScene, values: Values, camera: Camera) -> Float32[np.ndarray, "h w 3"]:
    return exact_image(scene.surfels(values, camera.centre), camera, scene.avatar.avatar.background)
