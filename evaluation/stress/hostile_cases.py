"""Cases of hostile and damaged files: payloads, false claims, wrong arrays and fields, and random damage."""

from __future__ import annotations

import copy
import io
import json
import pickle
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

RANDOM_DAMAGE = 24
"""Randomly damaged files of each reader."""
PROTECTED = ("npz", "png", "path", "shading", "head model", "gnm", "parameters", "avatar", "subject", "pt")
"""Readers of formats with checksums: a damaged file must be noticed, or be read as if it were sound."""
ARRAYS = ("npz", "path", "shading", "head model", "gnm", "parameters", "avatar", "subject")
"""Readers of .npz files."""


class Case(NamedTuple):
    """A file for a reader."""

    name: str
    reader: str
    content: bytes
    must_fail: bool = False
    """Whether only an error is right."""
    protected: bool = False
    """Whether what is read must equal what is read from the sound file."""


def cases(sound: Mapping[str, bytes]) -> Iterator[Case]:
    """All cases, in a fixed order.

    Args:
        sound: Content of a sound file of each reader.

    Yields:
        The cases.
    """
    yield from _payloads(sound)
    for reader in ARRAYS[1:]:
        yield from _wrong_arrays(reader, sound[reader])
    for reader in ("capture", "targets", "frames", "truth"):
        yield from _wrong_fields(reader, sound[reader])
    yield from _claims(sound)
    yield from _yaml(sound["settings"])
    yield from _overrides()
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


# Code in pickles.

NAMES = (
    "os system", "posix system", "subprocess getoutput", "builtins eval", "builtins exec", "builtins open",
    "builtins getattr", "builtins __import__", "numpy load", "numpy fromfile", "numpy savetxt", "numpy memmap",
    "numpy.testing runstring", "numpy.testing measure", "numpy.testing._private.utils os.system",
    "numpy ndarray.tofile", "numpy.core.multiarray fromfile", "numpy.ctypeslib load_library", "pickle loads",
    "torch load", "shutil rmtree", "pathlib Path.touch", "importlib import_module", "operator attrgetter",
    "functools partial", "types FunctionType", "codecs open", "ctypes CDLL", "timeit timeit", "runpy run_path",
    "copyreg __newobj__", "scipy.io loadmat", "scipy.sparse load_npz", "chumpy.ch Ch.__init__", "_codecs lookup",
    "builtins bytes.fromhex", "carigs.readers.pickles read_pickle",
)  # fmt: skip


def _payloads(sound: Mapping[str, bytes]) -> Iterator[Case]:
    for names in NAMES:
        module, name = names.split()
        argument = b"import os;os.system('touch ran')" if "run" in name or "e" in name[:2] else b"touch ran"
        texts = b"".join(b"\x8c" + bytes([len(text)]) + text.encode() for text in (module, name))
        named = b"\x8c" + bytes([len(argument)]) + argument
        programs = {
            "GLOBAL": f"c{module}\n{name}\n(S'".encode() + argument.replace(b"'", b'"') + b"'\ntR.",
            "STACK_GLOBAL": b"\x80\x04" + texts + b"\x93" + named + b"\x85R.",
            "INST": b"(S'" + argument.replace(b"'", b'"') + f"'\ni{module}\n{name}\n.".encode(),
            "NEWOBJ": b"\x80\x04" + texts + b"\x93" + named + b"\x85\x81.",
            "BUILD": b"\x80\x04" + texts + b"\x93}\x8c\x01x" + named + b"sb.",
        }
        for form, program in programs.items():
            yield Case(f"{form} {module}.{name}", "pickle", program, must_fail=True)
        inside = b"\x80\x04}\x8c\x01a" + programs["STACK_GLOBAL"][2:-1] + b"s."
        yield Case(f"in FLAME: {module}.{name}", "flame", inside, must_fail=True)
        header = sound["pickled npy"][: sound["pickled npy"].index(b"\n") + 1]
        yield Case(f"in .npy: {module}.{name}", "pickled npy", header + inside, must_fail=True)
        stream = io.BytesIO()
        with zipfile.ZipFile(io.BytesIO(sound["pt"])) as archive, zipfile.ZipFile(stream, "w") as changed:
            for member in archive.namelist():
                changed.writestr(member, inside if member.endswith("data.pkl") else archive.read(member))
        yield Case(f"in torch.save: {module}.{name}", "pt", stream.getvalue(), must_fail=True)
        yield Case(f"legacy torch.save: {module}.{name}", "legacy", inside, must_fail=True)


# Arrays of .npz files.

FREE_LENGTH = ("report", "name", "names")
INDICES = ("faces", "triangles", "f", "binding", "columns", "mask_nose", "kintree_table")


def _wrong_arrays(reader: str, content: bytes) -> Iterator[Case]:
    with np.load(io.BytesIO(content)) as archive:
        sound = dict(archive)
    for name, array in sound.items():
        if name in ("format", "rig") or name.endswith(FREE_LENGTH):
            continue
        changes: dict[str, tuple[Any, bool]] = {
            "a text": (np.full(array.shape, "x"), array.size > 0),
            "complex": (array.astype(complex) * 1j, array.size > 0),
            "objects": (np.array([None, {}], object), True),
            "8 dimensions": (np.zeros((1,) * 8), False),
            "empty": (np.zeros(0, array.dtype), array.size > 0 and not name.endswith("nose")),
            "a column less": (
                array[..., :-1] if array.ndim > 1 else array[None],
                array.ndim != 1 and array.size > 0 and name not in ("shapedirs", "expr"),  # fewer coefficients
            ),
            "as float16": (np.nan_to_num(array.astype(np.float16)), False),
            "all 1e38": (np.full(array.shape, 1e38), False),
            "all 1e-300": (np.full(array.shape, 1e-300), False),
        }
        if array.dtype.kind == "f" and array.size:
            for value in (np.nan, np.inf):
                changed = array.copy()
                changed[(-1,) * array.ndim] = value
                changes[f"one {value}"] = changed, True
        if array.dtype.kind in "iu" and name.endswith(INDICES) and array.size:
            for value in (-2, 2**31 - 1, 2**32, 2**62):
                changed = array.astype(np.int64)
                changed[(0, -1) if array.ndim > 1 else -1] = value
                changes[f"index {value}"] = changed, True
        for change, (value, must_fail) in changes.items():
            stream = io.BytesIO()
            np.savez(stream, **{**sound, name: value})
            optional = name in ("landmarks68", "expression_names")
            yield Case(f"{name}: {change}", reader, stream.getvalue(), must_fail=must_fail and not optional)
        stream = io.BytesIO()
        np.savez(stream, **{key: value for key, value in sound.items() if key != name})
        yield Case(f"{name}: missing", reader, stream.getvalue())


# Fields of JSON files.

VALUES: tuple[Any, ...] = (None, -1, 1e308, "", "x" * 5000, "\0", [], {}, True, 2**62, "../" * 40 + "etc/passwd")


def _wrong_fields(reader: str, content: bytes) -> Iterator[Case]:
    sound = json.loads(content)
    for place in _places(sound):
        for value in VALUES:
            changed = copy.deepcopy(sound)
            inner = changed
            for key in place[:-1]:
                inner = inner[key]
            inner[place[-1]] = value
            name = ".".join(map(str, place))
            yield Case(f"{name} = {json.dumps(value)[:20]}", reader, json.dumps(changed).encode())


def _places(value: Any, at: tuple = ()) -> Iterator[tuple]:
    """Paths to all values; of a matrix only those of one row."""
    if at:
        yield at
    items = value.items() if isinstance(value, dict) else enumerate(value[:1]) if isinstance(value, list) else ()
    for key, item in items:
        yield from _places(item, (*at, key))


# Claims of sizes, and other formats.


def _claims(sound: Mapping[str, bytes]) -> Iterator[Case]:
    for shape, dtype in (
        ((10**12,), "<f8"), ((2**62, 4), "<f8"), ((-1,), "<f8"), ((3,), "O"), ((10**12,), "<U0"), ((0,), "<c16"),
        ((3,), "<M8[s]"), ((1,), "V8"), ((1,) * 40, "<f8"), ((10**9, 10**9, 0), "<f8"),
    ):  # fmt: skip
        header = f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}, }}".ljust(245) + "\n"
        content = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header.encode()
        yield Case(f"claims {shape[:3]} {dtype}", "npy", content, must_fail=dtype not in ("<f8",) or 0 not in shape)
    for text in ("__import__('os').system('touch ran')", "{}" * 9, "(" * 5000, "{'shape': 10**10**10}"):
        content = b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode()
        yield Case(f"header {text[:30]}", "npy", content, must_fail=True)
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("v.npy", bytes(200 << 20))
    yield Case("200 MB of zeros", "npz", stream.getvalue(), must_fail=True)
    for reader in ("png", "size of png"):
        for width, height in ((60_000, 60_000), (2**31 - 1, 2**31 - 1), (2**32 - 1, 1), (0, 7), (20_000, 20_000)):
            content = bytearray(sound["png"])
            content[16:24] = width.to_bytes(4, "big") + height.to_bytes(4, "big")
            content[29:33] = zlib.crc32(bytes(content[12:29])).to_bytes(4, "big")
            yield Case(f"claims {width} x {height}", reader, bytes(content), must_fail=reader == "png")
    others = {
        "gif": b"GIF89a\x01\x00\x01\x00\x00\x00\x00;", "bmp": b"BM" + bytes(60), "tiff": b"II*\x00" + bytes(60),
        "exr": b"v/1\x01" + bytes(60), "hdr": b"#?RADIANCE\n", "pnm": b"P6 9 9 255 ", "svg": b"<svg/>", "nothing": b"",
    }  # fmt: skip
    for kind, content in others.items():
        for reader in ("png", "jpg", "mesh.glb", "mesh.ply", "surfels", "npz", "pt", "safetensors", "pickle", "json"):
            yield Case(f"a {kind}", reader, content, must_fail=True)
    for place in range(2, 300, 12):
        content = bytearray(sound["jpg"])
        content[place : place + 4] = b"\xff\xff\xff\xff"
        yield Case(f"0xff at {place}", "jpg", bytes(content))
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
    for text in (
        b"[" * 100_000, b'{"a":' * 100_000, b"[" + b"9" * 400 + b"]", b"[NaN]", b"[1e999]", b'{"a": 1, "a": 2}',
        b"[1,]",
        "[1]".encode("utf-16"), b"\xff\xfe", b"'a'", b"[1] 2", b'"\x00"', b"[" + b"1e5" * 9 + b"]", b"",
    ):  # fmt: skip
        yield Case(repr(text[:20]), "json", text, must_fail=True)
    for program in (
        b"\x80\x02r\xff\xff\xff\xffN.", b"\x80\x04)" + b"\x85" * 300_000 + b".", b"\x80\x04\x8e" + b"\xff" * 8 + b".",
        b"\x80\x04}(" + b")" + b"\x85" * 300_000 + b"K\x01u.", b"(" * 10**6 + b".", b"\x80\x02]" + b"2a" * 30 + b".",
        pickle.dumps([1]), pickle.dumps({1: 2}), pickle.dumps({"a": frozenset()}),
        pickle.dumps({"a": 1j}), b".", b"I1\n.",
    ):  # fmt: skip
        yield Case(repr(program[:20]), "pickle", program, must_fail=program[:1] != b"(" or True)
    for length in (0, 2**40, 2**63 - 1, 7):
        content = length.to_bytes(8, "little") + sound["safetensors"][8:]
        yield Case(f"header of {length} bytes", "safetensors", content, must_fail=True)


def _glb(content: bytes, old: bytes, new: bytes) -> bytes:
    """Replace a part of the JSON of a .glb file; its chunk is padded again."""
    length = int.from_bytes(content[12:16], "little")
    text = content[20 : 20 + length].replace(b" ", b"").replace(old, new)
    text += b" " * (-len(text) % 4)
    rest = content[20 + length :]
    total = 20 + len(text) + len(rest)
    return content[:8] + total.to_bytes(4, "little") + len(text).to_bytes(4, "little") + content[16:20] + text + rest


# YAML and overrides.


def _yaml(sound: bytes) -> Iterator[Case]:
    bomb = b"a: &a [x,x,x,x,x,x,x,x,x]\n"
    for before, name in zip(b"abcdefgh", b"bcdefghi", strict=True):
        bomb += b"%c: &%c [%s]\n" % (name, name, b",".join([b"*%c" % before] * 9))
    texts = (
        bomb, b"3", b"- 1", b"", b"null", b"a: 1\na: 2", b"iterations: !!python/name:os.system x", sound + b"\nx: 1\n",
        sound + sound, sound + b"---\n" + sound, b"seed: " + b"[" * 10**5, b"seed: " + b"{a: " * 50_000,
        sound.decode().encode("utf-16"),
        b"? [1]\n: 2", b"seed: '", b"\x00", b"%YAML 9.9\n---\n" + sound, b"<<: {seed: 1}", b"seed: 0x" + b"f" * 400,
        sound.replace(b"seed: 0", b"seed: " + b"9" * 5000), sound.replace(b"seed: 0", b"seed: 1e400"),
        sound.replace(b"seed: 0", b"seed: .nan"), sound.replace(b"seed: 0", b"seed: [0]"), sound[: len(sound) // 2],
        sound.replace(b"seed: 0", b"seed: ${seed}"), sound.replace(b"seed: 0", b"seed: ${oc.env:HOME}"),
        sound.replace(b"ssim_weight: 0.2", b"ssim_weight: .inf"), sound.replace(b"ssim_weight: 0.2",
        b"ssim_weight: 1:30"),
        b"# x\n" * 10**6, b"a: &a [*a]",
    )  # fmt: skip
    for i, text in enumerate(texts):
        yield Case(f"{i}: {text[:30]!r}", "settings", text, must_fail=True)


def _overrides() -> Iterator[Case]:
    keys = (
        "gamma", "study.name", "study.levels", "study.subjects", "capture.source", "capture.background",
        "capture.toy.width",
        "exaggerate.regions", "exaggerate.path_nodes", "gtstar.max_stretch", "train.iterations", "train.position_lr",
        "train.mask_flags", "train.density.stop", "metrics.edit_prompt", "figures.camera", "tabulate.confidence",
    )  # fmt: skip
    values = (
        "nan", "inf", "-inf", "1e400", "-1e308", "9" * 400, "9" * 5000, "[[1]]", "{a:{b:1}}", "''", "${oc.env:HOME}",
        "${oc.decode:x}", "${gamma}", "${missing}", "!!python/name:os.system", "[" * 40, "'", "a b", "../../x", "\\\\",
    )  # fmt: skip
    for key in keys:
        for value in values:
            number = not key.startswith(("study.name", "study.subjects", "capture.source", "metrics"))
            never = value in ("nan", "inf", "1e400", "[[1]]", "{a:{b:1}}", "9" * 400) and number
            yield Case(f"{key}={value[:30]}", "override", f"{key}={value}".encode(), must_fail=never)
    for text in (
        "hydra.searchpath=[pkg://antigravity]", "+hydra.searchpath=[file:///]", "hydra/launcher=basic",
        "hydra.run.dir=elsewhere",
        "~train", "+x=1", "++train.seed=1", "=1", "", "train", "train={}", "train=null", "train.seed", "seed=1", "@x=1",
        "subject@y=toy", "study=../../../etc/passwd", "study=/etc/passwd", "exaggerate=[robust,paper]", "\0=1", "a=\0",
        "train.seed=1,2", "train.seed=range(9)", "train.seed=choice(1,2)", "study=${oc.env:HOME}",
        "train.seed=int('1')",
        "capture={source:folder}", "capture.source=folder", "train.seed=json_str('1')", "gamma=0.1 gamma=0.2",
    ):  # fmt: skip
        allowed = text in ("train={}", "exaggerate=[robust,paper]", "train.seed=int('1')")
        yield Case(text[:40], "override", text.encode(), must_fail=not allowed)
