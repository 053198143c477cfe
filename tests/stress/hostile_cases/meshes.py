"""Meshes and surfels: false counts, indices and references to other files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from stress.hostile_cases.case import Case


def wrong_surfels(sound: Mapping[str, bytes]) -> Iterator[Case]:
    """Files of surfels with false counts, missing properties and wrong bindings.

    Args:
        sound: Content of a sound file of each reader.

    Yields:
        The cases.
    """
    ply = sound["surfels"]
    for count in (b"0", b"-1", b"1000000000", b"9" * 300, b"39", b"41", b"x"):
        content = ply.replace(b"element vertex 40", b"element vertex " + count)
        yield Case(f"{count[:12].decode()} vertices", "surfels", content, must_fail=True)
    yield Case("44 f_rest", "surfels", ply.replace(b"property float f_rest_44\n", b"property float other\n"), True)
    for name in ("f_rest_3", "binding_0", "rot_0", "opacity", "x"):
        content = ply.replace(f"property float {name}\n".encode(), b"property float other\n")
        yield Case(f"no {name}", "surfels", content, must_fail=True)
    for value in (-5.0, 1e9, np.nan, np.inf, 0.5, -0.0):
        content = ply[:-4] + np.float32(value).tobytes()
        yield Case(f"binding {value}", "surfels", content, must_fail=value != 0)


def wrong_meshes(sound: Mapping[str, bytes]) -> Iterator[Case]:
    """Mesh files of each format with false counts, wrong indices, and names of other files.

    Args:
        sound: Content of a sound file of each reader.

    Yields:
        The cases.
    """
    for line in (
        "f 1 2 0", "f 1 2 99", "f 1 2 -99", "f 1 2 99999999999999999999", "v nan 0 0\nf 1 2 13",
        "v 1e400 0 0\nf 1 2 13",
        "v 1e150 0 0\nf 1 2 13", "f a b c", "v 1 2", "f 1//", "f", "v \0 0 0", "f 1.5 2 3",
    ):  # fmt: skip
        yield Case(line.replace("\n", "; "), "mesh.obj", sound["mesh.obj"] + b"\n" + line.encode() + b"\n")
    for line in ("mtllib /dev/zero", "mtllib ../../etc/passwd", "usemtl x\nmtllib |touch ran", "call x.obj"):
        yield Case(line.replace("\n", "; "), "mesh.obj", line.encode() + b"\n" + sound["mesh.obj"])
    for header in ("OFF\n1000000000 1 0\n", "OFF\n-1 1 0\n", "OFF\n3 1000000000 0\n0 0 0\n1 0 0\n0 1 0\n", "OFF\n"):
        yield Case(header.replace("\n", " ")[:30], "mesh.off", header.encode(), must_fail=True)
    for count in (0, 19, 21, 2**31, 2**32 - 1):
        content = sound["mesh.stl"][:80] + count.to_bytes(4, "little") + sound["mesh.stl"][84:]
        yield Case(f"{count} triangles", "mesh.stl", content, must_fail=count in (0, 2**31, 2**32 - 1))
    for old, new in (
        (b'"count":', b'"count":9999999'), (b'"byteLength":', b'"byteLength":9999999'), (b'"uri"', b'"uri"'),
        (b'"bufferView":0', b'"bufferView":9'), (b'"byteOffset":0', b'"byteOffset":-9'), (b'"type":"VEC3"',
        b'"type":"MAT4"'),
    ):  # fmt: skip
        yield Case(f"{old.decode()} -> {new.decode()}", "mesh.glb", _glb(sound["mesh.glb"], old, new))


def _glb(content: bytes, old: bytes, new: bytes) -> bytes:
    """Replace a part of the JSON of a .glb file; its chunk is padded again."""
    length = int.from_bytes(content[12:16], "little")
    text = content[20 : 20 + length].replace(b" ", b"").replace(old, new)
    text += b" " * (-len(text) % 4)
    rest = content[20 + length :]
    total = 20 + len(text) + len(rest)
    return content[:8] + total.to_bytes(4, "little") + len(text).to_bytes(4, "little") + content[16:20] + text + rest
