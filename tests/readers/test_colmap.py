"""COLMAP's camera models: the order of their parameters in COLMAP's documentation (src/colmap/sensor/models.h)."""

import struct
from pathlib import Path

import pytest

from carigs.readers.colmap import MODELS, read_colmap

PINHOLES = {
    "SIMPLE_PINHOLE": (50.0, 20.5, 24.25),
    "PINHOLE": (50.0, 52.0, 20.5, 24.25),
    "SIMPLE_RADIAL": (50.0, 20.5, 24.25, 0.0),
    "RADIAL": (50.0, 20.5, 24.25, 0.0, 0.0),
    "OPENCV": (50.0, 52.0, 20.5, 24.25, *[0.0] * 4),
    "FULL_OPENCV": (50.0, 52.0, 20.5, 24.25, *[0.0] * 8),
}
"""Parameters of cameras without distortion: one focal length or two, principal point, distortion."""
POSE = (1.0, 0.0, 0.0, 0.0, 0.1, 0.2, 0.3)


def write_text(folder: Path, model: str) -> None:
    parameters = " ".join(map(repr, PINHOLES[model]))
    (folder / "cameras.txt").write_text(f"7 {model} 40 48 {parameters}\n")
    (folder / "images.txt").write_text(f"3 {' '.join(map(repr, POSE))} 7 a.png\n\n")


def write_binary(folder: Path, model: str) -> None:
    parameters = PINHOLES[model]
    camera = struct.pack(f"<QIiQQ{len(parameters)}d", 1, 7, MODELS.index(model), 40, 48, *parameters)
    (folder / "cameras.bin").write_bytes(camera)
    image = struct.pack("<QI7dI", 1, 3, *POSE, 7) + b"a.png\0" + struct.pack("<Q", 0)
    (folder / "images.bin").write_bytes(image)


@pytest.mark.parametrize("write", [write_text, write_binary])
@pytest.mark.parametrize("model", PINHOLES)
def test_models_without_distortion_are_pinholes(tmp_path, model, write):
    write(tmp_path, model)
    (image,) = read_colmap(tmp_path)
    assert image.camera == (50.0, 52.0 if "OPENCV" in model or model == "PINHOLE" else 50.0, 20.5, 24.25, 40, 48)
    assert (image.name, *image.quaternion, *image.translation) == ("a.png", *POSE)
