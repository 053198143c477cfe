"""COLMAP's models: false counts, cameras that cannot exist, names that lead elsewhere, cut off anywhere."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping

from stress.hostile_cases.case import Case

CUTS = 40
"""Places at which each binary file is cut off."""
NAMES = (
    "../../../etc/passwd", "/etc/passwd", "/", ".", "..", "left/..", "left/0000.png\0/../x", "a" * 5000, "\ud7ff", "~",
    "left/0000.png ", "-1", "right/0000.png", "|touch ran", "left\n0000.png",
)  # fmt: skip


def wrong_models(sound: Mapping[str, bytes]) -> Iterator[Case]:
    """Cameras and images of both encodings, changed field by field.

    Args:
        sound: Content of a sound file of each reader.

    Yields:
        The cases.
    """
    yield from _wrong_texts(sound["cameras.txt"], sound["images.txt"])
    yield from _wrong_binaries(sound["cameras.bin"], sound["images.bin"])
    for reader in ("points3D.txt", "points3D.bin"):  # which are not read
        for content in (b"", b"\xff" * 100, b"1 nan nan nan\n" * 10**5):
            yield Case(f"{len(content)} bytes", reader, content, protected=True)


def _wrong_texts(cameras: bytes, images: bytes) -> Iterator[Case]:
    comment, count, first, *others = cameras.decode().splitlines()
    number, model, width, height, *numbers = first.split()
    changes = {
        "no model": [number, width, height, *numbers], "unknown model": [number, "FISHEYE", width, height, *numbers],
        "distorted": [number, "OPENCV", width, height, *numbers, "0.1", "0", "0", "0"], "nothing": [number],
        "three numbers": [number, model, width, height, *numbers[:3]],
        "other id": ["9", model, width, height, *numbers],
        "same id": ["2", model, width, height, *numbers], "negative id": ["-1", model, width, height, *numbers],
    }  # fmt: skip
    sizes = ("0", "-64", "1e9", "9" * 400, "9" * 5000, "nan", "64.5", "")
    changes |= {f"width {size[:9]}": [number, model, size, height, *numbers] for size in sizes}
    values = ("0", "-60", "nan", "inf", "1e400", "1e-300", "x", "0x10")
    changes |= {f"focal length {f}": [number, model, width, height, f, *numbers[1:]] for f in values}
    changes |= {
        f"cx {c}": [number, model, width, height, *numbers[:2], c, numbers[3]]
        for c in ("nan", "inf", "1e400", "x", "0x10", "-1")
    }
    for name, words in changes.items():
        content = "\n".join([comment, count, " ".join(words), *others, ""]).encode()
        yield Case(name, "cameras.txt", content, must_fail=True)
    for content in (cameras + others[0].encode(), b"\n".join(cameras.splitlines()[:-1]), b"# none\n", b"\xff\xfe1 "):
        yield Case(f"{len(content)} bytes", "cameras.txt", content, must_fail=True)
    header, (line, points, *rest) = images.decode().splitlines()[:2], images.decode().splitlines()[2:]
    number, *pose, camera, name = line.split()
    for place in range(7):
        for value in ("nan", "inf", "1e400", "", "x", "1e30"):
            words = [number, *pose[:place], value, *pose[place + 1 :], camera, name]
            content = "\n".join([*header, " ".join(words), points, *rest]).encode()
            yield Case(f"pose[{place}] = {value}", "images.txt", content, must_fail=True)
    for camera_id in ("0", "-1", "3", "9" * 5000, "x"):
        content = "\n".join([*header, " ".join([number, *pose, camera_id, name]), points, *rest]).encode()
        yield Case(f"camera {camera_id[:9]}", "images.txt", content, must_fail=True)
    for other in NAMES:
        content = "\n".join([*header, " ".join([number, *pose, camera, other]), points, *rest])
        yield Case(f"name {other[:20]!r}", "images.txt", content.encode("utf-8", "surrogatepass"))
    yield Case("a line less", "images.txt", b"\n".join(images.splitlines()[:-2]), must_fail=True)
    yield Case("10^6 points", "images.txt", images + b"1.5 2.5 -1 " * 10**6, protected=True)


def _wrong_binaries(cameras: bytes, images: bytes) -> Iterator[Case]:
    for reader, content in (("cameras.bin", cameras), ("images.bin", images)):
        for count in (0, 1, 3, 2**32, 2**63, 2**64 - 1):
            yield Case(f"claims {count}", reader, struct.pack("<Q", count) + content[8:], must_fail=True)
        for length in range(0, len(content), max(len(content) // CUTS, 1)):
            yield Case(f"cut at {length}", reader, content[:length], must_fail=True)
        yield Case("a byte more", reader, content + b"\0", must_fail=True)
        yield Case("twice", reader, content + content, must_fail=True)
    for model in (-1, 0, 4, 10, 11, 2**31 - 1):
        yield Case(f"model {model}", "cameras.bin", _at(cameras, 12, "<i", model), must_fail=True)
    for size in (0, 2**32, 2**63, 2**64 - 1):
        yield Case(f"width {size}", "cameras.bin", _at(cameras, 16, "<Q", size), must_fail=True)
    for place in range(4):
        for value in (float("nan"), float("inf"), -1.0, 1e308):
            yield Case(f"{place}: {value}", "cameras.bin", _at(cameras, 32 + 8 * place, "<d", value), must_fail=True)
    for place in range(7):
        for value in (float("nan"), float("inf"), 1e308):
            yield Case(f"{place}: {value}", "images.bin", _at(images, 12 + 8 * place, "<d", value), must_fail=True)
    for camera in (0, 3, 2**32 - 1):
        yield Case(f"camera {camera}", "images.bin", _at(images, 68, "<I", camera), must_fail=True)
    end = images.index(b"\0", 72)
    for points in (0, 2, 2**32, 2**60, 2**64 - 1):
        yield Case(f"{points} points", "images.bin", _at(images, end + 1, "<Q", points), must_fail=True)
    for name in NAMES:
        encoded = name.encode("utf-8", "surrogatepass")
        yield Case(f"name {name[:20]!r}", "images.bin", images[:72] + encoded + images[end:])
    yield Case("no end of a name", "images.bin", images[:72] + b"x" * 10**6, must_fail=True)
    yield Case("a name of bytes", "images.bin", images[:72] + b"\xff\xfe" + images[end:], must_fail=True)


def _at(content: bytes, position: int, form: str, value: float) -> bytes:
    part = struct.pack(form, value)
    return content[:position] + part + content[position + len(part) :]
