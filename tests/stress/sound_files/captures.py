"""Captures of other programs: calibrations, mesh sequences, tracks and datasets, and what reads them."""

from __future__ import annotations

import contextlib
import io
import json
import shutil
import struct
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from carigs.capture import OPENCV_FROM_OPENGL, read_dataset
from carigs.capture.images import write_png
from carigs.capture.importers.cameras import read_cameras
from carigs.capture.importers.flame_tracks import read_flame_track, read_tracked_cameras
from carigs.capture.importers.images import FoundImage
from carigs.capture.importers.mesh_sequence import read_mesh_sequence
from carigs.cli.conversion.captures import main as convert_capture
from carigs.fitting.footage import read_footage
from carigs.head import HeadModel, HeadParameters
from stress.sound_files.ball import CAMERA, FACES, VERTICES, head_model

STEPS, CAMERAS = 3, ("left", "right")
POSES = [CAMERA.camera_from_world, CAMERA.camera_from_world @ np.diag([-1.0, 1, -1, 1])]
"""World to camera, of each camera: from the front and from behind."""
HEAD_MODEL = "head_model.npz"


def write_sound_files(folder: Path) -> None:
    """Write a sound file for every reader of captures.

    Args:
        folder: Where they are written.
    """
    random = np.random.default_rng(5)
    _write_colmap(folder / "text/sparse/0", binary=False)
    _write_colmap(folder / "binary/sparse/0", binary=True)
    _write_capture(folder / "capture", random)
    (folder / "ply_meshes").mkdir()
    for t in range(STEPS):
        (folder / f"ply_meshes/{t}.ply").write_text(_ply(_moved(t)))
    model = head_model()
    frames = [HeadParameters(expression=random.normal(size=100)) for _ in range(STEPS)]
    _write_vhap(folder / "tracked_flame_params_0.npz", frames, model)
    for name in ("track", "metrical"):
        (folder / name).mkdir()
    for t, frame in enumerate(frames):
        frame.save(folder / f"track/{t:05d}.npz", model)
        np.savez(
            folder / f"metrical/{t:05d}.npz", exp=frame.expression[None, :50], shape=frame.shape[None],
            jaw=np.eye(3)[:2].reshape(1, 6), eyes=np.tile([1.0, 0, 0, 0, 1, 0], 2)[None],
            R=POSES[0][None, :3, :3], t=POSES[0][None, :3, 3],
            K=np.array([[[CAMERA.fx, 0, CAMERA.cx], [0, CAMERA.fy, CAMERA.cy], [0, 0, 1]]]),
        )  # fmt: skip
    _write_dataset(folder / "dataset", model, frames)


def _write_colmap(folder: Path, *, binary: bool) -> None:
    folder.mkdir(parents=True)
    text = {"cameras": ["# Camera list", "# Number of cameras: 2"], "images": ["# Image list", "# Number of images: 2"]}
    data = {kind: struct.pack("<Q", len(CAMERAS)) for kind in text}
    k = CAMERA
    for c, (name, pose) in enumerate(zip(CAMERAS, POSES, strict=True)):
        values = [*Rotation.from_matrix(pose[:3, :3]).as_quat(scalar_first=True), *pose[:3, 3]]
        text["cameras"].append(f"{c + 1} PINHOLE {k.width} {k.height} {k.fx!r} {k.fy!r} {k.cx!r} {k.cy!r}")
        text["images"] += [f"{c + 7} {' '.join(repr(float(v)) for v in values)} {c + 1} {name}/0000.png", "1.5 2.5 -1"]
        data["cameras"] += struct.pack("<IiQQ4d", c + 1, 1, k.width, k.height, k.fx, k.fy, k.cx, k.cy)
        data["images"] += struct.pack("<I7dI", c + 7, *values, c + 1) + f"{name}/0000.png".encode() + b"\0"
        data["images"] += struct.pack("<Qddq", 1, 1.5, 2.5, -1)
    for kind in text:
        if binary:
            (folder / f"{kind}.bin").write_bytes(data[kind])
        else:
            (folder / f"{kind}.txt").write_text("\n".join(text[kind]) + "\n")
    (folder / ("points3D.bin" if binary else "points3D.txt")).write_bytes(bytes(8) if binary else b"# none\n")


def _write_capture(folder: Path, random: np.random.Generator) -> None:
    """Images and mattes in a folder per camera, a mesh per timestep, and cameras.json."""
    for kind in ("images", "masks"):
        for name in CAMERAS:
            (folder / kind / name).mkdir(parents=True)
            for t in range(STEPS):
                shape = (CAMERA.height, CAMERA.width, *([3] if kind == "images" else []))
                write_png(folder / kind / name / f"{t:04d}.png", random.random(shape))
    (folder / "meshes").mkdir()
    for t in range(STEPS):
        lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in _moved(t).tolist()]
        lines += [f"f {a} {b} {c}" for a, b, c in (FACES + 1).tolist()]
        (folder / f"meshes/frame_{t}.obj").write_text("\n".join(lines))
    entries = [
        {
            "name": name, "width": CAMERA.width, "height": CAMERA.height, "fx": CAMERA.fx, "fy": CAMERA.fy,
            "cx": CAMERA.cx, "cy": CAMERA.cy, "camera_from_world": pose.tolist(),
        }
        for name, pose in zip(CAMERAS, POSES, strict=True)
    ]  # fmt: skip
    (folder / "cameras.json").write_text(json.dumps({"cameras": entries}))


def _moved(t: int) -> np.ndarray:
    return VERTICES.astype(np.float64) * (1 + 0.1 * t * (VERTICES[:, 1:2] > 0))


def _ply(vertices: np.ndarray) -> str:
    header = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}", *(f"property double {c}" for c in "xyz")]
    header += [f"element face {len(FACES)}", "property list uchar int vertex_indices", "end_header"]
    rows = [f"{x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()] + [f"3 {a} {b} {c}" for a, b, c in FACES.tolist()]
    return "\n".join([*header, *rows]) + "\n"


def _write_vhap(file: Path, frames: Sequence[HeadParameters], model: HeadModel) -> None:
    joints = np.array([frame.joints.reshape(-1) for frame in frames])
    offsets = np.zeros((len(frames), *model.v_template.shape))
    np.savez(
        file, rotation=np.array([f.rotation for f in frames]), translation=np.array([f.translation for f in frames]),
        neck_pose=joints[:, :3], jaw_pose=joints[:, 3:6], eyes_pose=joints[:, 6:], shape=frames[0].shape,
        expr=np.array([f.expression for f in frames]), static_offset=offsets[:1], dynamic_offset=offsets,
        timestep_id=np.array([f"{t:05d}" for t in range(len(frames))]),
    )  # fmt: skip


def _write_dataset(folder: Path, model: HeadModel, frames: Sequence[HeadParameters]) -> None:
    """The layout of GaussianAvatars; also as footage: transforms.json without head parameters."""
    for name in ("images", "fg_masks", "flame_param"):
        (folder / name).mkdir(parents=True)
    entries = []
    for t, frame in enumerate(frames):
        frame.save(folder / f"flame_param/{t:05d}.npz", model)
        for c, pose in enumerate(POSES):
            name = f"{t:05d}_{c:02d}.png"
            write_png(folder / "images" / name, np.full((CAMERA.height, CAMERA.width, 3), 0.1 * t + 0.3 * c))
            write_png(folder / "fg_masks" / name, np.ones((CAMERA.height, CAMERA.width)))
            entries.append(
                {
                    "timestep_index": t, "camera_index": c, "fl_x": CAMERA.fx, "fl_y": CAMERA.fy, "cx": CAMERA.cx,
                    "cy": CAMERA.cy, "w": CAMERA.width, "h": CAMERA.height,
                    "transform_matrix": (np.linalg.inv(pose) @ OPENCV_FROM_OPENGL).tolist(),
                    "file_path": f"images/{name}", "fg_mask_path": f"fg_masks/{name}",
                    "flame_param_path": f"flame_param/{t:05d}.npz",
                }
            )  # fmt: skip
    model.save(folder / HEAD_MODEL)
    for split, part in (("train", entries[:4]), ("test", entries[4:])):
        (folder / f"transforms_{split}.json").write_text(json.dumps({"frames": part}))
    footage = folder.with_name("footage")
    shutil.copytree(folder, footage)
    for split in ("train", "test"):
        (footage / f"transforms_{split}.json").unlink()
    (footage / "transforms.json").write_text(json.dumps({"frames": entries}))


def _converted(levels: int) -> Callable[[Path], Any]:
    """`carigs convert` of the capture that holds the file, so many folders above it."""

    def convert(file: Path) -> Any:
        source = file.parents[levels]
        target = source.with_name("converted")
        shutil.rmtree(target, ignore_errors=True)
        with contextlib.redirect_stdout(io.StringIO()):
            convert_capture([str(source), str(target), "--copy", *_head_model_option(source)])
        capture = read_dataset(target, target / HEAD_MODEL)
        return [(frame, capture.image8(frame), capture.parameters(frame.timestep)) for frame in capture.frames]

    return convert


def _head_model_option(source: Path) -> list[str]:
    return ["--head-model", str(source / HEAD_MODEL)] if (source / HEAD_MODEL).is_file() else []


def _metrical(file: Path) -> Any:
    image = file.parents[1] / "capture/images/left/0000.png"
    images = [FoundImage(image, t, "left") for t in range(STEPS)]
    return read_flame_track(file.parent, head_model()), read_tracked_cameras(file.parent, images)


def _dataset(file: Path) -> Any:
    return read_dataset(file.parents[0], file.parent / HEAD_MODEL)


READERS: dict[str, tuple[Callable[[Any], Any], str]] = {
    "cameras.txt": (lambda file: read_cameras(file.parent), "text/sparse/0/cameras.txt"),
    "images.txt": (lambda file: read_cameras(file.parent), "text/sparse/0/images.txt"),
    "points3D.txt": (lambda file: read_cameras(file.parent), "text/sparse/0/points3D.txt"),
    "cameras.bin": (lambda file: read_cameras(file.parent), "binary/sparse/0/cameras.bin"),
    "images.bin": (lambda file: read_cameras(file.parent), "binary/sparse/0/images.bin"),
    "points3D.bin": (lambda file: read_cameras(file.parent), "binary/sparse/0/points3D.bin"),
    "cameras.json": (read_cameras, "capture/cameras.json"),
    "sequence of .obj": (lambda file: read_mesh_sequence(file.parent), "capture/meshes/frame_1.obj"),
    "sequence of .ply": (lambda file: read_mesh_sequence(file.parent), "ply_meshes/1.ply"),
    "vhap": (lambda file: read_flame_track(file, head_model()), "tracked_flame_params_0.npz"),
    "track": (lambda file: read_flame_track(file.parent, head_model()), "track/00001.npz"),
    "metrical": (_metrical, "metrical/00001.npz"),
    "dataset": (_dataset, "dataset/transforms_train.json"),
    "footage": (lambda file: read_footage(file.parent, file.parent / HEAD_MODEL), "footage/transforms.json"),
    "converted image": (_converted(2), "capture/images/left/0001.png"),
    "converted matte": (_converted(2), "capture/masks/left/0001.png"),
    "converted cameras": (_converted(0), "capture/cameras.json"),
    "converted mesh": (_converted(1), "capture/meshes/frame_0.obj"),
    "converted parameters": (_converted(1), "dataset/flame_param/00001.npz"),
}
"""Function and file of each reader."""
