"""Files of GaussianAvatars and SurFhead: false counts, other types and encodings, missing and impossible values."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping

import numpy as np

from stress.hostile_cases.case import Case

LAYOUTS = ("gaussian_avatars", "surfhead", "no_jbs")
OPTIONAL = ("nx", "ny", "nz")
"""Properties that no reader needs."""
END = b"end_header\n"


def wrong_splats(sound: Mapping[str, bytes]) -> Iterator[Case]:
    """Files of each layout, changed in the header and in the values.

    Args:
        sound: Content of a sound file of each reader.

    Yields:
        The cases.
    """
    for reader in LAYOUTS:
        header, body = sound[reader].split(END, 1)
        header += END
        names = [line.split()[-1].decode() for line in header.splitlines() if line.startswith(b"property")]
        values = np.frombuffer(body, "<f4").reshape(-1, len(names))
        yield from _wrong_headers(reader, header, body, names)
        yield from _wrong_values(reader, header, values, names)
        yield from _other_encodings(reader, header, values, names)


def _wrong_headers(reader: str, header: bytes, body: bytes, names: list[str]) -> Iterator[Case]:
    count = b"element vertex " + str(len(body) // 4 // len(names)).encode()
    for other in (b"0", b"1", b"39", b"41", b"-1", b"4e1", b"0x28", b"9" * 15, b"9" * 400, b""):
        content = header.replace(count, b"element vertex " + other) + body
        yield Case(f"{other[:9].decode()} vertices", reader, content, must_fail=True)
    for name in names:
        line = f"property float {name}\n".encode()
        if name.startswith("f_rest") and name not in ("f_rest_0", "f_rest_44"):
            continue
        without = header.replace(line, b"property float other\n") + body
        yield Case(f"no {name}", reader, without, must_fail=not name.startswith((*OPTIONAL, "blend", "f_sg", "scale")))
    for kind in (b"double", b"uchar", b"int", b"list uchar float", b"list int float", b"list float int", b"half", b""):
        for name in (b"x", b"opacity", b"binding_0"):
            content = header.replace(b"property float " + name + b"\n", b"property " + kind + b" " + name + b"\n")
            yield Case(f"{name.decode()} as {kind.decode()}", reader, content + body, must_fail=True)
    twice = header.replace(b"property float y\n", b"property float x\n")
    yield Case("x twice", reader, twice + body, must_fail=True)
    yield Case("two elements vertex", reader, header.replace(END, count + b"\n" + END) + body, must_fail=True)
    yield Case("no end_header", reader, header.replace(END, b"") + body, must_fail=True)
    yield Case("100 MB of comments", reader, header[: -len(END)] + b"comment x\n" * 10**7 + END + body, must_fail=True)
    yield Case("100 MB without a line break", reader, b"ply\n" + b"x" * 10**8, must_fail=True)
    more = header.replace(END, b"element huge 999999999999999\nproperty list uchar int i\n" + END)
    yield Case("a huge list", reader, more + body, must_fail=True)
    lists = header.replace(END, b"element face 1\nproperty list uint float i\n" + END)
    yield Case("a list of 2^32 - 1", reader, lists + body + struct.pack("<I", 2**32 - 1), must_fail=True)
    signed = header.replace(END, b"element face 1\nproperty list int float i\n" + END)
    yield Case("a list of -1", reader, signed + body + struct.pack("<i", -1), must_fail=True)
    empty = header.replace(END, b"element face 1000000\nproperty list uchar int i\n" + END)
    yield Case("10^6 empty lists", reader, empty + body + bytes(10**6), protected=True)
    for length in (0, 3, 10, len(header) - 1, len(header), len(header) + 1):
        yield Case(f"cut at {length}", reader, (header + body)[:length], must_fail=True)
    yield Case("half", reader, header + body[: len(body) // 2], must_fail=True)
    yield Case("a byte more", reader, header + body + b"x", must_fail=True)


def _wrong_values(reader: str, header: bytes, values: np.ndarray, names: list[str]) -> Iterator[Case]:
    used = ("x", "f_dc_0", "f_rest_0", "opacity", "scale_0", "scale_1", "rot_0", "binding_0")
    for name in (*used, *(n for n in ("blend_weight_0", "scale_2", "f_sg_0") if n in names)):
        for value in (np.nan, np.inf, -np.inf, 3e38, 1e30, 100.0, -1e30, -100.0):
            changed = values.copy()
            changed[7, names.index(name)] = value
            must_fail = not np.isfinite(value) or name == "binding_0"
            yield Case(f"{name} = {value}", reader, header + changed.tobytes(), must_fail=must_fail)
    for value in (-1.0, 80.0, 0.5, 1e9):
        changed = values.copy()
        changed[0, names.index("binding_0")] = value
        yield Case(f"binding {value}", reader, header + changed.tobytes(), must_fail=True)
    for name in ("rot", "scale"):
        changed = values.copy()
        changed[:, [n.startswith(name) for n in names]] = 0
        yield Case(f"all {name} 0", reader, header + changed.tobytes())


def _other_encodings(reader: str, header: bytes, values: np.ndarray, names: list[str]) -> Iterator[Case]:
    """The same numbers: what is read must be the same."""
    little = b"format binary_little_endian 1.0"
    big = header.replace(little, b"format binary_big_endian 1.0") + values.astype(">f4").tobytes()
    yield Case("big-endian", reader, big, protected=True)
    double = header.replace(b"property float ", b"property double ") + values.astype("<f8").tobytes()
    yield Case("double", reader, double, protected=True)
    rows = "\n".join(" ".join(repr(float(v)) for v in row) for row in values)
    text = header.replace(little, b"format ascii 1.0")
    yield Case("ascii", reader, text + rows.encode(), protected=True)
    yield Case("ascii with a word", reader, text + rows.encode().replace(b" ", b" x ", 1), must_fail=True)
    yield Case("ascii with a number less", reader, text + rows.rpartition(" ")[0].encode(), must_fail=True)
    yield Case("ascii, 1e999", reader, text + ("1e999" + rows[rows.index(" ") :]).encode(), must_fail=True)
    order = np.random.default_rng(0).permutation(len(names))
    start, lines = header.split(b"property", 1)[0], b"".join(f"property float {names[i]}\n".encode() for i in order)
    yield Case("other order", reader, start + lines + END + values[:, order].tobytes(), protected=True)
    for old, new in ((little, b"format binary_middle_endian 1.0"), (little, b"format ascii 1.0"), (b"ply\n", b"PLY\n")):
        content = header.replace(old, new) + values.tobytes()
        yield Case(new.decode().strip(), reader, content, must_fail=True)
    yield Case("CRLF", reader, header.replace(b"\n", b"\r\n") + values.tobytes(), protected=True)
