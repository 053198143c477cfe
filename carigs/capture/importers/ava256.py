"""Captures of Ava-256 (Martinez et al. 2024), as the download of the dataset leaves them in a folder.

    DATE--TIME--ID/decoder/
        camera_calibration.json                        of images of 2668 x 4096 pixels
        frame_list.csv                                 columns seg_id, frame_id
        head_pose/head_pose.zip                        FRAME.txt: the pose of the head in the dome, 3 x 4, millimetres
        image/camCAMERA.zip                            camCAMERA/FRAME.avif, scaled down
        kinematic_tracking/registration_vertices.zip   FRAME.ply: 7306 vertices in the head's own frame, millimetres
        segmentation_parts/camCAMERA.zip               camCAMERA/FRAME.png: the class of each pixel
    face_topology.obj                                  from the repository of the dataset

Archives are read member by member. A member counts by its file name, whatever folder of the archive it is in.
"""

from __future__ import annotations

import csv
import io
from pathlib import Path, PurePosixPath
from typing import NamedTuple

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
from carigs.readers.archives import Archive
from carigs.readers.arrays import checked_array
from carigs.readers.folders import listed
from carigs.readers.images import parse_avif
from carigs.readers.json_files import json_field, read_json
from carigs.readers.limits import MAX_IMAGE_BYTES, MAX_TEXT_BYTES, read_bytes
from carigs.readers.mesh_files.ply import parse_ply_polygons
from carigs.readers.text import decode_text

DECODER, CALIBRATION, FRAMES, TOPOLOGY = "decoder", "camera_calibration.json", "frame_list.csv", "face_topology.obj"
HEAD_POSES, MESHES = "head_pose/head_pose.zip", "kinematic_tracking/registration_vertices.zip"
IMAGES, LABELS = "image", "segmentation_parts"
CALIBRATED_HEIGHT, CALIBRATED_WIDTH = 4096, 2668
"""Pixels of the images that the calibration is for."""
NEUTRAL_SEGMENTS, TEST_SEGMENTS = ("EXP_neutral_peak",), ("EXP_free_face",)
LEFT_OUT = frozenset(
    {
        "EXP_Neutral_color_checker",
        "EXP_ear",
        "EXP_hair_dynamics_hand_interaction",
        "EXP_hair_dynamics_no_hand_interaction",
        "EXP_neutral_hairline",
    }
)
"""Segments that the authors do not train with: hands or a chart cover the head, or hair flies."""
MAX_MESH_BYTES = 64 << 20


class Calibration(NamedTuple):
    """A camera, for images of the calibrated size."""

    intrinsics: Float[np.ndarray, "3 3"]
    """In pixels, whose centres are whole numbers."""
    camera_from_world: Float[np.ndarray, "4 4"]
    """In metres, to OpenCV axes."""
    distortion: Float[np.ndarray, "4"]
    """k1, k2, p1, p2 of OpenCV."""

    def scaled(self, width: int, height: int, file: Path) -> Camera:
        """The pinhole camera of images that were scaled down.

        Args:
            width: Of the images.
            height: Of the images.
            file: The images, for messages.

        Returns:
            The camera, without the distortion.

        Raises:
            InputError: If the images have another ratio of sides than those that were calibrated.
        """
        scale = CALIBRATED_HEIGHT / height
        if abs(CALIBRATED_WIDTH / scale - width) > 1:
            problem = f"{width} x {height} pixels are no scaled {CALIBRATED_WIDTH} x {CALIBRATED_HEIGHT}"
            raise InputError(f"{problem}, which the calibration is for", file=file)
        fx, fy, cx, cy = (float(self.intrinsics[i]) for i in ((0, 0), (1, 1), (0, 2), (1, 2)))
        centre = [(cx + 0.5) / scale, (cy + 0.5) / scale]
        return Camera(self.camera_from_world, fx / scale, fy / scale, *centre, width, height)


def is_ava256(folder: Path) -> bool:
    """Whether a folder is a capture of Ava-256.

    Args:
        folder: The folder.

    Returns:
        Whether it, or its folder `decoder`, holds a calibration under the name of the dataset.
    """
    return any((place / CALIBRATION).is_file() for place in (folder, folder / DECODER))


def read_ava256(folder: Path, *, topology: Path | None = None, stride: int = 1) -> Dome:
    """Index a capture of Ava-256.

    Args:
        folder: The capture, or its folder `decoder`.
        topology: face_topology.obj of the dataset's repository. None: it lies in the folder, or up to two above it.
        stride: Every n-th frame of each segment is taken.

    Returns:
        The capture. Frames without a mesh or a head pose are left out; some are missing in the dataset.

    Raises:
        InputError: If a file is missing or broken.
    """
    folder = folder / DECODER if (folder / DECODER).is_dir() else folder
    calibrations = read_calibration(folder / CALIBRATION)
    near = [place / TOPOLOGY for place in (folder, *list(folder.absolute().parents)[:2])]
    topology = topology or next((file for file in near if file.is_file()), None)
    if topology is None:
        remedy = f"name {TOPOLOGY} of the dataset's repository by --topology, or put it there"
        raise InputError(f"no {TOPOLOGY}: the meshes have no faces", file=folder, remedy=remedy)
    surface = Surface.read(topology)
    with Archive(folder / HEAD_POSES) as archive:
        members, meshes = members_by_number(archive, ".txt"), Archive(folder / MESHES)
        plys = members_by_number(meshes, ".ply")
        taken: dict[str, list[DomeFrame]] = {}
        for frame in read_frame_list(folder / FRAMES):
            if frame.timestep in members and frame.timestep in plys:
                taken.setdefault(frame.segment, []).append(frame)
        frames = sorted(frame for segment in taken.values() for frame in segment[::stride])
        if not frames:
            raise InputError("no frame of it has a mesh and a head pose", file=folder / FRAMES)
        poses = [
            rigid_in_metres(text_matrix(archive.read(name, MAX_MATRIX_BYTES), (3, 4), archive.file, name))
            for name in (members[frame.timestep] for frame in frames)
        ]

    stored = {file.name for file in listed(folder / IMAGES)}  # also links to nothing, which are errors
    seen = {name: found for name, found in calibrations.items() if f"cam{name}.zip" in stored}
    if not seen:
        raise InputError("holds no archives camCAMERA.zip of calibrated cameras", file=folder / IMAGES)

    def vertices(place: int) -> np.ndarray:
        name = plys[frames[place].timestep]
        file = meshes.file / name
        return surface.vertices(parse_ply_polygons(meshes.read(name, MAX_MESH_BYTES), file).vertices, file)

    def view(name: str) -> View:
        with Archive(folder / _images_of(name)) as archive:
            members = members_by_number(archive, ".avif")
            images = {t: f"{_images_of(name)}/{t:06d}.avif" for t, _ in frames if t in members}
            if not images:
                raise InputError("no frame has an image", file=archive.file)
            first = members[min(images)]
            height, width, _ = parse_avif(archive.read(first, MAX_IMAGE_BYTES), archive.file / first).shape
        camera = calibrations[name].scaled(width, height, archive.file)
        labels = folder / LABELS / f"cam{name}.zip"
        if labels not in listed(folder / LABELS):
            return View(camera, images, {})
        with Archive(labels) as archive:
            labelled = members_by_number(archive, ".png")
        return View(camera, images, {t: image for t, image in images.items() if t in labelled})

    return Dome(
        folder=folder,
        frames=frames,
        faces=surface.faces,
        vertices=MeshesOnDisk(len(frames), vertices),
        world_from_head=np.stack(poses),
        poses={name: found.camera_from_world for name, found in seen.items()},
        view=view,
        neutral_segments=NEUTRAL_SEGMENTS,
        test_segments=TEST_SEGMENTS,
    )


def read_calibration(file: Path) -> dict[str, Calibration]:
    """Read camera_calibration.json.

    Args:
        file: {"KRT": [{"cameraId", "K", "T", "distortion"}, ...]}. Both matrices are transposed: K is 3 x 3, and T is
            4 x 4 with the translation in millimetres as its last row.

    Returns:
        Calibrations by the names of the cameras.

    Raises:
        InputError: If something is missing or broken, or two cameras have one name.
    """
    cameras: dict[str, Calibration] = {}
    for i, entry in enumerate(json_field(read_json(file, dict), "KRT", list, file=file)):
        where = f"KRT[{i}]"
        name = json_field(entry, "cameraId", str, file=file, where=where)
        if name in cameras or PurePosixPath(name).name != name:
            raise InputError("expected names of cameras, all different", file=file, field=f"{where}.cameraId")
        model = entry.get("distortionModel", "RadialAndTangential")
        if model != "RadialAndTangential":
            raise InputError("only RadialAndTangential is read", file=file, field=f"{where}.distortionModel")
        shapes = {"K": (3, 3), "T": (4, 4), "distortion": (4,)}
        rows = {f"{where}.{key}": json_field(entry, key, list, file=file, where=where) for key in shapes}
        k, t, distortion = (
            checked_array(rows, f"{where}.{key}", shape, np.float64, file=file) for key, shape in shapes.items()
        )
        if k.T[[0, 1, 2, 2, 2], [1, 0, 0, 1, 2]].tolist() != [0, 0, 0, 0, 1] or t[:, 3].tolist() != [0, 0, 0, 1]:
            problem = "expected a transposed matrix of a camera without skew, and a transposed rigid transform"
            raise InputError(problem, file=file, field=f"{where}.K, T")
        cameras[name] = Calibration(k.T, rigid_in_metres(t.T[:3]), distortion)
    if not cameras:
        raise InputError("holds no cameras", file=file, field="KRT")
    return cameras


def read_frame_list(file: Path) -> list[DomeFrame]:
    """Read frame_list.csv.

    Args:
        file: A table with the columns seg_id and frame_id.

    Returns:
        The frames in the order of the file, without those of `LEFT_OUT`.

    Raises:
        InputError: If a column is missing, or frames have no number or the same.
    """
    reader = csv.DictReader(io.StringIO(decode_text(read_bytes(file, MAX_TEXT_BYTES, "list of frames"), file)))
    frames: dict[int, str] = {}
    try:
        rows = list(reader)
    except csv.Error as error:
        raise InputError(f"not a readable table ({error})", file=file) from error
    for row in rows:
        for column in ("seg_id", "frame_id"):
            if row.get(column) is None:
                raise InputError("this column is missing, or empty in a row", file=file, field=column)
        timestep = stated_timestep(row["frame_id"].strip())
        if timestep is None or timestep in frames:
            raise InputError(f"{row['frame_id'][:20]!r}: expected different numbers", file=file, field="frame_id")
        frames[timestep] = row["seg_id"].strip()
    return [DomeFrame(timestep, segment) for timestep, segment in frames.items() if segment not in LEFT_OUT]


def members_by_number(archive: Archive, suffix: str) -> dict[int, str]:
    """Find the members of an archive that belong to frames.

    Args:
        archive: The archive.
        suffix: End of their names.

    Returns:
        Names by the number that is the file name.

    Raises:
        InputError: If two members belong to one frame.
    """
    found: dict[int, str] = {}
    for name in archive.names:
        path = PurePosixPath(name)
        timestep = stated_timestep(path.stem) if path.suffix.lower() == suffix else None
        if timestep is not None and found.setdefault(timestep, name) != name:
            raise InputError(f"two members belong to frame {timestep}", file=archive.file, field=name)
    return found


def _images_of(camera: str) -> str:
    return f"{IMAGES}/cam{camera}.zip"
