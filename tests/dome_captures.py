"""Miniature captures in the layouts of Ava-256 and Multiface: a bust with an open neck in a tilted dome."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from miniature import bust_model
from PIL import Image
from scipy.spatial.transform import Rotation

from carigs.capture import Camera, look_at
from carigs.raster import rasterize_mesh

NAMES = ("400002", "400015", "400023", "400070")
SIZE = (42, 64)
"""Width and height: 1 / 64 of what Ava-256's cameras see."""
SCALE = 64
SEGMENTS = ("EXP_neutral_peak", "EXP_eye_wide", "EXP_ear", "EXP_free_face")
MILLIMETRES = 1000


@dataclass(frozen=True)
class DomeBust:
    """What is shown. Lengths are in metres; frames have the numbers 17, 20, 23, ..."""

    frames_per_segment: int = 3
    modes: int = 3
    size: tuple[int, int] = SIZE
    names: tuple[str, ...] = NAMES
    segments: tuple[str, ...] = SEGMENTS
    rig_from_world: np.ndarray = field(
        default_factory=lambda: rigid([2.0, 0.3, -0.4], [0.1, -0.05, 1.2])
    )  # the dome's frame is not y up

    @cached_property
    def bust(self):
        """The head: its lowest vertices, below the neck, are in no triangle."""
        model = bust_model()
        low = (model.v_template[model.faces, 1] < -0.075).any(axis=1)
        return replace(model, faces=model.faces[~low])

    @cached_property
    def frames(self) -> dict[int, str]:
        """Segments by the number of the frame."""
        return {
            17 + 3 * (i * self.frames_per_segment + k): segment
            for i, segment in enumerate(self.segments)
            for k in range(self.frames_per_segment)
        }

    def local(self, frame: int) -> np.ndarray:
        """Vertices in the head's own frame; those of EXP_neutral_peak are nearly at rest."""
        points = self.bust.v_template.astype(np.float64)
        size = 0.02 if self.frames[frame] == "EXP_neutral_peak" else 1.0
        for k in range(self.modes):
            bump = np.exp(-((points - points[37 * (k + 1)]) ** 2).sum(axis=1) / 0.002)
            points = points + size * 0.012 * np.sin(frame * (k + 1)) * bump[:, None] * np.array([0.3, -1, 0.5])
        return points

    def rig_from_head(self, frame: int) -> np.ndarray:
        """Pose of the head in the dome."""
        turn = rigid([0.05 * np.sin(frame), 0.15 * np.cos(frame), 0.02], [0.01 * np.sin(frame), 0.004, 0.01])
        return self.rig_from_world @ turn

    @cached_property
    def cameras(self) -> dict[str, Camera]:
        """Cameras of the dome by name, for images of `size`."""
        width, height = self.size
        cameras = {}
        for i, name in enumerate(self.names):
            angle = np.radians((-60, -5, 35, 170)[i] if len(self.names) == 4 else 300 * i / len(self.names) - 150)
            centre = np.array([np.sin(angle), 0.1 * (-1) ** i, np.cos(angle)])
            pose = look_at(centre, np.array([0, -0.01, 0.0])) @ np.linalg.inv(self.rig_from_world)
            focal = 2.6 * height
            cameras[name] = Camera(pose, focal, 1.01 * focal, width / 2 + 1.5, height / 2 - 2.25, width, height)
        return cameras

    def picture(self, frame: int, name: str) -> tuple[np.ndarray, np.ndarray]:
        """RGB values (colour by place at rest, on grey) and classes: 1 hair, 2 skin, and 3 a chair behind the head."""
        pose = self.rig_from_head(frame)
        points = self.local(frame) @ pose[:3, :3].T + pose[:3, 3]
        hit = rasterize_mesh(points, self.bust.faces, self.cameras[name])
        albedo = 0.5 + 3 * self.bust.v_template
        corners = self.bust.faces[hit.face]
        colours = np.einsum("hwc,hwcx->hwx", hit.barycentric, albedo[corners])
        heights = np.einsum("hwc,hwc->hw", hit.barycentric, self.bust.v_template[corners, 1])
        seen = hit.face >= 0
        classes = np.where(seen, np.where(heights > 0.06, 1, 2), 0)
        classes[:3][~seen[:3]] = 3  # above the neck
        colours = np.where(seen[..., None], colours, 0.1)
        return np.rint(255 * colours.clip(0, 1)).astype(np.uint8), classes.astype(np.uint8)


def rigid(turn: Iterable[float], translation: Iterable[float]) -> np.ndarray:
    """A rigid transform of a rotation vector and a translation."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = Rotation.from_rotvec(list(turn)).as_matrix(), list(translation)
    return matrix


def rows_in_millimetres(matrix: np.ndarray) -> np.ndarray:
    """The three rows of a rigid transform, as both datasets store them."""
    return np.column_stack([matrix[:3, :3], MILLIMETRES * matrix[:3, 3]])


def matrix_text(matrix: np.ndarray) -> str:
    """Numbers with as many digits as a float32 has."""
    return "".join(" ".join(f"{x:.9g}" for x in row) + "\n" for row in matrix)


def ply(vertices: np.ndarray) -> bytes:
    """Vertices without faces, as in registration_vertices.zip."""
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n"
    header += "".join(f"property float {c}\n" for c in "xyz") + "end_header\n"
    return header.encode() + vertices.astype("<f4").tobytes()


def avif(rgb: np.ndarray) -> bytes:
    """An AVIF image whose values differ by a few levels."""
    stream = io.BytesIO()
    Image.fromarray(rgb).save(stream, "AVIF", quality=100, subsampling="4:4:4")
    return stream.getvalue()


def write_zip(file: Path, members: dict[str, bytes]) -> None:
    """An archive without compression, as those of the dataset."""
    file.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(file, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)


def write_topology(file: Path, bust: DomeBust) -> None:
    """Faces with texture coordinates; the positions are of somebody else."""
    points = 500 + MILLIMETRES * bust.bust.v_template
    lines = [f"v {x:.5f} {y:.5f} {z:.5f}" for x, y, z in points.tolist()]
    lines += ["vt 0.5 0.5"] + ["f " + " ".join(f"{i + 1}/1" for i in face) for face in bust.bust.faces.tolist()]
    file.write_text("\n".join(lines) + "\n")


def write_ava256(folder: Path, bust: DomeBust, distortion: tuple[float, ...] = (-0.07, 0.04, -0.003, 0.003)) -> Path:
    """A capture of Ava-256 below `folder`, with face_topology.obj beside it. One image is missing."""
    capture = folder / "20230405--1635--AAN112"
    decoder = capture / "decoder"
    decoder.mkdir(parents=True)
    write_topology(folder / "face_topology.obj", bust)
    entries = []
    for name, camera in bust.cameras.items():
        fx, fy, cx, cy = camera.intrinsics
        k = np.array(
            [[SCALE * fx, 0, SCALE * cx - 0.5], [0, SCALE * fy, SCALE * cy - 0.5], [0, 0, 1]]
        )  # of images that are 64 times as large, whose pixel centres are whole numbers
        t = np.vstack([rows_in_millimetres(camera.camera_from_world), [0, 0, 0, 1]])
        entries.append(
            {
                "cameraId": name,
                "projectionModel": "Pinhole",
                "distortionModel": "RadialAndTangential",
                "K": k.T.tolist(),
                "distortion": list(distortion),
                "T": t.T.tolist(),
            }
        )
    (decoder / "camera_calibration.json").write_text(json.dumps({"KRT": entries}, indent=1))
    listed = [*bust.frames.items(), (9000, "EXP_eye_wide")]  # without a mesh
    (decoder / "frame_list.csv").write_text("seg_id,frame_id\n" + "".join(f"{s},{f}\n" for f, s in listed))
    poses = {f"{f:06d}.txt": matrix_text(rows_in_millimetres(bust.rig_from_head(f))).encode() for f in bust.frames}
    write_zip(decoder / "head_pose/head_pose.zip", poses)
    meshes = {f"{f:06d}.ply": ply(MILLIMETRES * bust.local(f)) for f in bust.frames}
    write_zip(decoder / "kinematic_tracking/registration_vertices.zip", meshes)
    missing = (list(bust.frames)[4 % len(bust.frames)], bust.names[0])
    for name in bust.names:
        pictures = {f: bust.picture(f, name) for f in bust.frames}
        images = {f"cam{name}/{f:06d}.avif": avif(rgb) for f, (rgb, _) in pictures.items() if (f, name) != missing}
        write_zip(decoder / f"image/cam{name}.zip", images)
        labels = {
            f"cam{name}/{f:06d}.png": cv2.imencode(".png", classes)[1].tobytes() for f, (_, classes) in pictures.items()
        }
        write_zip(decoder / f"segmentation_parts/cam{name}.zip", labels)
    return capture


def write_multiface(folder: Path, bust: DomeBust) -> Path:
    """A capture of Multiface below `folder`."""
    capture = folder / "m--20180227--0000--6795937--GHS"
    capture.mkdir(parents=True)
    blocks = []
    for name, camera in bust.cameras.items():
        fx, fy, cx, cy = camera.intrinsics
        k = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        pose = rows_in_millimetres(camera.camera_from_world)
        blocks.append(f"{name}\n{matrix_text(k)}0.0 0.0 0.0 0.0 0.0\n{matrix_text(pose)}")
    (capture / "KRT").write_text("\n".join(blocks) + "\n")
    (capture / "frame_list.txt").write_text("".join(f"{s} {f:06d}\n" for f, s in bust.frames.items()))
    for f, segment in bust.frames.items():
        meshes = capture / "tracked_mesh" / segment
        meshes.mkdir(parents=True, exist_ok=True)
        write_topology(meshes / f"{f:06d}.obj", bust)
        (meshes / f"{f:06d}.bin").write_bytes((MILLIMETRES * bust.local(f)).astype("<f4").tobytes())
        pose = rows_in_millimetres(bust.rig_from_head(f))
        (meshes / f"{f:06d}_transform.txt").write_text(matrix_text(pose))
        for name in bust.names:
            rgb, _ = bust.picture(f, name)
            image = capture / "images" / segment / name / f"{f:06d}.png"
            image.parent.mkdir(parents=True, exist_ok=True)
            image.write_bytes(cv2.imencode(".png", rgb[..., ::-1])[1].tobytes())
    return capture
