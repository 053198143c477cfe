"""The miniature capture in other forms: images and mattes in folders, cameras.json, COLMAP models."""

from __future__ import annotations

import json
import struct
from pathlib import Path

from miniature import ball_cameras
from scipy.spatial.transform import Rotation

from carigs.capture import Capture

NAMES = ("left", "middle", "right")
"""Of the cameras, in the order of their numbers."""


def write_images(folder: Path, capture: Capture) -> None:
    """Images and mattes as CAMERA/TIMESTEP.png."""
    for frame in capture.frames:
        for kind, name in (("images", frame.image), ("masks", frame.mask)):
            file = folder / kind / NAMES[frame.camera] / f"{frame.timestep:04d}.png"
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes((capture.root / name).read_bytes())


def write_cameras(folder: Path) -> None:
    """cameras.json."""
    entries = [
        dict(name=NAMES[c], width=k.width, height=k.height, fx=k.fx, fy=k.fy, cx=k.cx, cy=k.cy,
             camera_from_world=k.camera_from_world.tolist())
        for c, k in ball_cameras().items()
    ]  # fmt: skip
    (folder / "cameras.json").write_text(json.dumps({"cameras": entries}))


def write_colmap(folder: Path, binary: bool, names=tuple(f"{name}/0000.png" for name in NAMES), unit=1.0) -> None:
    """A COLMAP model as text or binary, whose unit of length is so many metres."""
    model = folder / "sparse/0"
    model.mkdir(parents=True)
    text = {"cameras": ["# comment"], "images": ["# comment"]}
    data = {kind: struct.pack("<Q", 3) for kind in text}
    for (c, k), name in zip(ball_cameras().items(), names, strict=True):
        x, y, z, w = Rotation.from_matrix(k.camera_from_world[:3, :3]).as_quat()
        values = [w, x, y, z, *k.camera_from_world[:3, 3] / unit]
        text["cameras"].append(f"{c + 1} PINHOLE {k.width} {k.height} {k.fx!r} {k.fy!r} {k.cx!r} {k.cy!r}")
        text["images"] += [f"{c + 7} {' '.join(repr(float(v)) for v in values)} {c + 1} {name}", "1.5 2.5 -1"]
        data["cameras"] += struct.pack("<IiQQ4d", c + 1, 1, k.width, k.height, k.fx, k.fy, k.cx, k.cy)
        data["images"] += struct.pack("<I7dI", c + 7, *values, c + 1) + name.encode() + b"\0"
        data["images"] += struct.pack("<Qddq", 1, 1.5, 2.5, -1)
    for kind in text:
        if binary:
            (model / f"{kind}.bin").write_bytes(data[kind])
        else:
            (model / f"{kind}.txt").write_text("\n".join(text[kind]) + "\n")
