"""Cases for every reader: files of other formats, and random damage."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from stress.hostile_cases.case import Case

RANDOM_DAMAGE = 24
"""Randomly damaged files of each reader."""
PROTECTED = (
    "npz", "png", "path", "shading", "head model", "gnm", "parameters", "avatar", "subject", "pt", "vhap",
    "track", "metrical", "converted image", "converted matte", "converted parameters", "flame_param.npz", "landmarks",
    "landmarks of a frame", "embedding", "embedding of vertices", "download", "avatar to 3dgs", "avatar to glTF",
    "multiface image",
)  # fmt: skip
"""Readers of formats with checksums: a damaged file must be noticed, or be read as if it were sound."""


def other_formats() -> Iterator[Case]:
    """Files of formats that no reader knows, and empty ones.

    Yields:
        The cases.
    """
    others = {
        "gif": b"GIF89a\x01\x00\x01\x00\x00\x00\x00;", "bmp": b"BM" + bytes(60), "tiff": b"II*\x00" + bytes(60),
        "exr": b"v/1\x01" + bytes(60), "hdr": b"#?RADIANCE\n", "pnm": b"P6 9 9 255 ", "svg": b"<svg/>", "nothing": b"",
    }  # fmt: skip
    for kind, content in others.items():
        for reader in ("png", "jpg", "mesh.glb", "mesh.ply", "surfels", "npz", "pt", "safetensors", "pickle", "json"):
            yield Case(f"a {kind}", reader, content, must_fail=True)


def random_damage(sound: Mapping[str, bytes]) -> Iterator[Case]:
    """Sound files with random changes.

    Args:
        sound: Content of a sound file of each reader.

    Yields:
        The cases.
    """
    random = np.random.default_rng(2026)
    for reader in sound:
        for i in range(RANDOM_DAMAGE):
            content = _damaged(sound[reader], random)
            yield Case(f"damage {i}", reader, content, protected=reader in PROTECTED)


def _damaged(content: bytes, random: np.random.Generator) -> bytes:
    """One to three random changes: cut off, flipped bits, replaced, repeated, removed or moved bytes."""
    result = bytearray(content)
    for _ in range(random.integers(1, 4)):
        at, length = int(random.integers(len(result) + 1)), int(random.integers(1, 64))
        kind = random.integers(6)
        if kind == 0:
            del result[at:]
        elif kind == 1 and at < len(result):
            result[at] ^= 1 << int(random.integers(8))
        elif kind == 2:
            result[at : at + length] = random.bytes(length)
        elif kind == 3:
            result[at:at] = result[at : at + length] * 3
        elif kind == 4:
            del result[at : at + length]
        else:
            result[at:at] = result[-length:]
    return bytes(result)
