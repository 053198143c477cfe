"""Captures of Multiface (Wuu et al. 2022), as the download of the dataset leaves them in a folder.

m--DATE--TIME--ID--GHS/
    KRT                                        calibrations, a block of eight lines per camera
    images/SEGMENT/CAMERA/FRAME.png            2048 x 1334 pixels
    tracked_mesh/SEGMENT/FRAME.obj             7306 vertices; of these files the faces count
    tracked_mesh/SEGMENT/FRAME.bin             the vertices in the head's own frame, float32, millimetres
    tracked_mesh/SEGMENT/FRAME_transform.txt   the pose of the head in the dome, 3 x 4, millimetres
    masks/SEGMENT/CAMERA/FRAME.png             mattes; the dataset has none
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from jaxtyping import Float

from carigs.capture.camera import Camera
from carigs.capture.importers.dome import Dome, DomeFrame, View
from carigs.capture.importers.images import stated_timestep
from carigs.capture.importers.registration import (
    MAX_MATRIX_BYTES,
    MeshesOnDisk,
    Surface,
    rigid_in_metres,
    text_matrix,
)
from carigs.errors import InputError
from carigs.readers.folders import listed
from carigs.readers.images import read_header
from carigs.readers.limits import MAX_TEXT_BYTES, read_bytes
from carigs.readers.text import decode_text, split_lines

CALIBRATION, IMAGES, MESHES, MATTES = "KRT", "images", "tracked_mesh", "masks"
NEUTRAL_SEGMENTS = ("E001_Neutral_Eyes_Open", "EXP_neutral_peak")
"""In the first and in the second script of the dataset."""
TEST_SEGMENTS = ("EXP_free_face", "EXP_ROM07_Facial_Expressions")
"""What the authors train without, in the second and in the first script."""
BLOCK = 8
"""Lines of a camera: its name, 3 of the intrinsics, 1 of the distortion, 3 of the pose."""


def is_multiface(folder: Path) -> bool:
    """Whether a folder is a capture of Multiface.

    Args:
        folder: The folder.

    Returns:
        Whether it holds calibrations and tracked meshes under the names of the dataset.
    """
    return (folder / CALIBRATION).is_file() and (folder / MESHES).is_dir()


def read_multiface(folder: Path, *, stride: int = 1) -> Dome:
    """Index a capture of Multiface.

    Args:
        folder: The capture. Expressions that were not downloaded may be missing.
        stride: Every n-th frame of each segment is taken.

    Returns:
        The capture.

    Raises:
        InputError: If a file is missing or broken.
    """
    calibrations = read_krt(folder / CALIBRATION)
    meshes: dict[DomeFrame, Path] = {}
    for segment in listed(folder / MESHES):
        for file in listed(segment, "*.bin")[::stride]:
            timestep = stated_timestep(file.stem)
            if timestep is None or any(timestep == frame.timestep for frame in meshes):
                raise InputError("meshes are called by the number of their frame, different ones", file=file)
            meshes[DomeFrame(timestep, segment.name)] = file
    if not meshes:
        raise InputError("holds no meshes SEGMENT/FRAME.bin", file=folder / MESHES)
    files = list(meshes.values())
    surface = Surface.read(files[0].with_suffix(".obj"))
    named = {image.name for segment in listed(folder / IMAGES) for image in listed(segment) if image.is_dir()}
    if not named & calibrations.keys():
        raise InputError("holds no folders SEGMENT/CAMERA of calibrated cameras", file=folder / IMAGES)

    def vertices(place: int) -> np.ndarray:
        size = 12 * surface.stored
        content = read_bytes(files[place], size, "mesh")
        if len(content) != size:
            problem = f"{len(content)} bytes, expected {size}: three float32 for each vertex of {surface.file.name}"
            raise InputError(problem, file=files[place])
        return surface.vertices(np.frombuffer(content, "<f4").reshape(-1, 3), files[place])

    def view(name: str) -> View:
        found = {frame: f"{IMAGES}/{frame.segment}/{name}/{file.stem}.png" for frame, file in meshes.items()}
        images = {frame.timestep: image for frame, image in found.items() if os.path.lexists(folder / image)}
        if not images:
            raise InputError("no frame has an image", file=folder / IMAGES, field=f"camera {name}")
        mattes = {timestep: image.replace(IMAGES, MATTES, 1) for timestep, image in images.items()}
        mattes = {timestep: matte for timestep, matte in mattes.items() if os.path.lexists(folder / matte)}
        header = read_header(folder / next(iter(images.values())))
        intrinsics, pose = calibrations[name]
        camera = Camera(pose, *map(float, intrinsics[[0, 1, 0, 1], [0, 1, 2, 2]]), header.width, header.height)
        return View(camera, images, mattes)

    return Dome(
        folder=folder,
        frames=list(meshes),
        faces=surface.faces,
        vertices=MeshesOnDisk(len(files), vertices),
        world_from_head=np.stack([_head_pose(file.with_name(f"{file.stem}_transform.txt")) for file in files]),
        poses={name: calibrations[name][1] for name in sorted(named & calibrations.keys())},
        view=view,
        neutral_segments=NEUTRAL_SEGMENTS,
        test_segments=TEST_SEGMENTS,
    )


def read_krt(file: Path) -> dict[str, tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "4 4"]]]:
    """Read the calibrations of a capture.

    Args:
        file: Blocks of eight lines: name, intrinsics (3 x 3), distortion (5 numbers), pose (3 x 4, millimetres, world
            to OpenCV axes). Empty lines are passed over.

    Returns:
        Intrinsics in pixels and `camera_from_world` in metres of each camera.

    Raises:
        InputError: If a block is broken, a name appears twice, or a lens has a distortion.
    """
    lines = [line for line in split_lines(decode_text(read_bytes(file, MAX_TEXT_BYTES), file)) if line.strip()]
    if not lines or len(lines) % BLOCK:
        raise InputError(f"{len(lines)} lines, expected {BLOCK} for each camera", file=file)
    cameras: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for start in range(0, len(lines), BLOCK):
        name, block = lines[start].strip(), lines[start + 1 : start + BLOCK]
        field = f"camera {name}"
        if name in cameras:
            raise InputError("two cameras have this name", file=file, field=field)
        intrinsics = text_matrix("\n".join(block[:3]), (3, 3), file, field)
        if intrinsics[[0, 1, 2, 2, 2], [1, 0, 0, 1, 2]].tolist() != [0, 0, 0, 0, 1]:
            raise InputError("expected the intrinsics of a camera without skew", file=file, field=field)
        if text_matrix(block[3], (1, 5), file, field).any():
            remedy = "undistort its images, and write zeros"
            raise InputError("lens distortion is not applied", file=file, field=field, remedy=remedy)
        cameras[name] = intrinsics, rigid_in_metres(text_matrix("\n".join(block[4:]), (3, 4), file, field))
    return cameras


def _head_pose(file: Path) -> Float[np.ndarray, "4 4"]:
    return rigid_in_metres(text_matrix(read_bytes(file, MAX_MATRIX_BYTES, "head pose"), (3, 4), file))
