"""A parser of binary .ply files for tests, with struct alone, and a writer of random files in other tools' layouts."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

GAUSSIAN_AVATARS = (
    "x y z nx ny nz f_dc_0 f_dc_1 f_dc_2 ".split()
    + [f"f_rest_{i}" for i in range(45)]
    + "opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3 binding_0".split()
)
SURFHEAD = (
    "x y z nx ny nz blend_weight_0 blend_weight_1 blend_weight_2 blend_weight_3 f_dc_0 f_dc_1 f_dc_2 ".split()
    + [f"f_rest_{i}" for i in range(45)]
    + "opacity scale_0 scale_1 rot_0 rot_1 rot_2 rot_3".split()
    + [f"f_sg_{i}" for i in range(24)]
    + ["binding_0"]
)
SURFHEAD_WITHOUT_JBS = [name for name in SURFHEAD if not name.startswith("blend")]
FLAVOURS = {"gaussian_avatars": GAUSSIAN_AVATARS, "surfhead": SURFHEAD, "surfhead without JBS": SURFHEAD_WITHOUT_JBS}


def parse_ply(file: Path) -> tuple[dict[str, np.ndarray], list[str]]:
    """Columns of the only element, whose properties are all float32, and the lines of the header."""
    content = file.read_bytes()
    end = content.index(b"end_header\n") + len(b"end_header\n")
    header = content[:end].decode("ascii").splitlines()
    count = next(int(line.split()[2]) for line in header if line.startswith("element vertex"))
    names = [line.split()[2] for line in header if line.startswith("property float ")]
    assert header[:2] == ["ply", "format binary_little_endian 1.0"]
    assert sum(line.startswith(("element", "property")) for line in header) == 1 + len(names)
    assert len(content) - end == 4 * count * len(names)
    rows = [struct.unpack_from(f"<{len(names)}f", content, end + 4 * len(names) * i) for i in range(count)]
    return dict(zip(names, np.array(rows).T, strict=True)), header


def write_random_ply(file: Path, names: list[str], faces: int, n: int = 200, seed: int = 0) -> dict[str, np.ndarray]:
    """A file as another program writes it: any order of rows, any length of quaternions, any thinnest axis."""
    rng = np.random.default_rng(seed)
    columns = {name: rng.normal(size=n).astype(np.float32) for name in names}
    for name in ("nx", "ny", "nz"):
        columns[name][:] = 0
    for name in names:
        if name.startswith("scale"):
            columns[name] = (0.5 * columns[name] - 0.7).astype(np.float32)
    if "binding_0" in names:
        columns["binding_0"] = rng.integers(0, faces, n).astype(np.float32)
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {n}"]
    header += [*(f"property float {name}" for name in names), "end_header", ""]
    body = b"".join(struct.pack(f"<{len(names)}f", *row) for row in zip(*columns.values(), strict=True))
    file.write_bytes("\n".join(header).encode() + body)
    return columns


def stack(columns: dict[str, np.ndarray], name: str, count: int) -> np.ndarray:
    return np.stack([columns[f"{name}_{i}"].astype(np.float64) for i in range(count)], axis=1)
