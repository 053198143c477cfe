"""Damaged files of every kind: each is read right or refused with a typed error that names the file."""

from __future__ import annotations

import io
import json
import pickle
import struct
import tracemalloc
import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest
import scipy.sparse
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from carigs.errors import InputError
from carigs.readers.images import read_header, read_pixels
from carigs.readers.json_files import read_json
from carigs.readers.mesh_files.meshes import FORMATS, read_mesh
from carigs.readers.mesh_files.ply import read_ply_vertices
from carigs.readers.npz import read_npy, read_npz
from carigs.readers.pickles import read_pickle
from tests.readers.damage import damaged

RNG = np.random.default_rng(0)
ARRAYS = {"v": RNG.normal(size=(6, 3)).astype(np.float32), "f": np.arange(6, dtype=np.uint32).reshape(2, 3)}


def _npy(array: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def _npz(compressed: bool) -> bytes:
    stream = io.BytesIO()
    (np.savez_compressed if compressed else np.savez)(stream, **ARRAYS, name=np.array("head"))
    return stream.getvalue()


def _ply(encoding: str, body: bytes) -> bytes:
    lines = ["ply", f"format {encoding} 1.0", "element vertex 4", *(f"property float {name}" for name in "xyzw")]
    lists = ["element face 2", "property list uchar int vertex_indices"]
    return "\n".join([*lines, *lists, "end_header\n"]).encode() + body


BINARY_PLY = _ply("binary_little_endian", struct.pack("<16f B3i B4i", *range(16), 3, 0, 1, 2, 4, 0, 1, 2, 3))
TEXT_PLY = _ply("ascii", b"0 1 2 3\n" * 4 + b"3 0 1 2\n4 0 1 2 3\n")


def _mesh(kind: str) -> bytes:
    solid = trimesh.creation.icosahedron()
    if kind == "gltf":
        return trimesh.exchange.gltf.export_gltf(solid.scene(), embed_buffers=True)["model.gltf"]
    content = solid.export(file_type=kind)
    return content.encode() if isinstance(content, str) else content


PIXELS = (RNG.random((9, 7, 3)) * 255).astype(np.uint8)
FLAME = {**ARRAYS, "J": scipy.sparse.csc_matrix(np.eye(3)), "bs_type": "lrotmin"}
CASES = {
    "array.npy": (read_npy, [_npy(ARRAYS["v"]), _npy(np.array(["a", "bc"]))]),
    "arrays.npz": (read_npz, [_npz(False), _npz(True)]),
    "model.pkl": (read_pickle, [pickle.dumps(FLAME, protocol) for protocol in (0, 1, 2, 4, 5)]),
    "index.json": (read_json, [json.dumps({"frames": [{"w": 1, "m": [0.5, -2e3]}], "n": None}).encode()]),
    "image.png": (read_pixels, [cv2.imencode(".png", PIXELS)[1].tobytes()]),
    "image.jpg": (read_pixels, [cv2.imencode(".jpg", PIXELS)[1].tobytes()]),
    "size.png": (read_header, [cv2.imencode(".png", PIXELS)[1].tobytes(), cv2.imencode(".jpg", PIXELS)[1].tobytes()]),
    "surfels.ply": (read_ply_vertices, [BINARY_PLY, TEXT_PLY]),
    **{f"mesh{suffix}": (read_mesh, [_mesh(suffix[1:])]) for suffix in FORMATS},
}


@pytest.mark.filterwarnings("ignore:.*bytes after its triangles are left out")
@pytest.mark.parametrize("name", CASES)
def test_undamaged_files_are_read(name, tmp_path):
    read, contents = CASES[name]
    for content in contents:
        (tmp_path / name).write_bytes(content)
        assert read(tmp_path / name) is not None


@pytest.mark.sample(5)
@pytest.mark.filterwarnings("ignore:.*bytes after its triangles are left out")
@pytest.mark.parametrize("name", CASES)
@settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damage_gives_data_or_a_typed_error(name, tmp_path, data):
    read, contents = CASES[name]
    everything = tuple(content for _, (_, all_contents) in CASES.items() for content in all_contents)
    file = tmp_path / name
    file.write_bytes(data.draw(damaged(data.draw(st.sampled_from(contents)), everything)))
    try:
        read(file)
    except InputError as error:
        assert str(file) in str(error) and "\n" not in str(error)


@pytest.mark.filterwarnings("ignore:.*bytes after its triangles are left out")
@pytest.mark.parametrize("name", CASES)
def test_no_reader_opens_what_is_not_a_regular_file(name, tmp_path):
    read, _ = CASES[name]
    for path in (tmp_path, tmp_path / "missing" / name, Path("x\0" + name), Path("y" * 5000 + name)):
        if path == tmp_path and name.startswith("mesh"):
            continue  # its name has no suffix: another message
        with pytest.raises(InputError):
            read(path)
    loop = tmp_path / f"loop{Path(name).suffix}"
    loop.symlink_to(loop)
    pipe = tmp_path / f"pipe{Path(name).suffix}"
    __import__("os").mkfifo(pipe)
    for path in (loop, pipe):
        with pytest.raises(InputError):
            read(path)


# Claims: a small file must not make a reader allocate.


def _claiming_npz(shape: tuple[int, ...], dtype: str = "<f8") -> bytes:
    header = f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr("v.npy", b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header.encode())
    return stream.getvalue()


def _png(width: int, height: int) -> bytes:
    content = bytearray(cv2.imencode(".png", PIXELS)[1].tobytes())
    content[16:24] = width.to_bytes(4, "big") + height.to_bytes(4, "big")
    content[29:33] = __import__("zlib").crc32(bytes(content[12:29])).to_bytes(4, "big")
    return bytes(content)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.npz", _claiming_npz((10**12,))),
        ("a.npz", _claiming_npz((2**62, 4))),
        ("a.npz", _claiming_npz((-1,))),
        ("a.npz", _claiming_npz((3,), "O")),
        ("a.npz", _claiming_npz((10**12,), "<U0")),
        ("a.npz", _claiming_npz((0,), "<c16")),
        ("a.png", _png(60_000, 60_000)),
        ("a.png", _png(0, 7)),
        ("a.ply", BINARY_PLY.replace(b"element vertex 4", b"element vertex 1000000000")),
        ("a.ply", BINARY_PLY.replace(b"element vertex 4", b"element vertex 0")),
        ("a.ply", BINARY_PLY.replace(b"element vertex 4", b"element vertex -4")),
        ("a.ply", BINARY_PLY.replace(b"element face 2", b"element face 2000000000")),
        ("a.ply", BINARY_PLY.replace(b"\x03\x00\x00\x00\x00\x01", b"\xff\x00\x00\x00\x00\x01")),
        ("a.ply", BINARY_PLY.replace(b"list uchar int", b"list char int").replace(b"\x04\x00", b"\xff\x00")),
        ("a.ply", TEXT_PLY.replace(b"\n3 0", b"\n1e15 0")),
        ("a.ply", TEXT_PLY.replace(b"\n3 0", b"\n2.5 0")),
        ("a.ply", TEXT_PLY.replace(b"\n3 0", b"\nnan 0")),
        ("a.ply", TEXT_PLY.replace(b"3\n3 0", b"three\n3 0")),
        ("a.ply", TEXT_PLY.replace(b"4 0 1 2 3", b"4 0 1 2")),
        ("a.ply", TEXT_PLY + b"7"),
        ("a.ply", BINARY_PLY.replace(b"format binary_little_endian 1.0\n", b"")),
        ("a.ply", BINARY_PLY.replace(b"float w", b"float x")),
        ("a.ply", BINARY_PLY.replace(b"element face", b"element vertex")),
        ("a.ply", b"ply\nformat ascii 1.0\nelement vertex 1000000000\nend_header\n"),
        ("m.ply", _mesh("ply").replace(b"element face 20", b"element face 2000000000")),
        ("a.json", b"[" * 100_000),
        ("a.json", b'{"a":' * 100_000),
        ("a.json", b"[" + b"9" * 400 + b"]"),
        ("a.json", b"[NaN]"),
        ("a.json", b"[1e999]"),
        ("a.json", b'{"a": 1, "a": 2}'),
        ("a.json", "[1]".encode("utf-16")),
        ("a.pkl", b"\x80\x02r\xff\xff\xff\xffN."),
        ("a.pkl", b"\x80\x04)" + b"\x85" * 300_000 + b"."),
        ("a.pkl", b"\x80\x04}(" + b")" + b"\x85" * 300_000 + b"K\x01u."),
        ("a.pkl", b"\x80\x04]" + b"\x8e\xff\xff\xff\xff\xff\xff\xff\x7fa."),
    ],
)
def test_a_claim_is_refused_without_being_allocated(name, content, tmp_path):
    (tmp_path / name).write_bytes(content)
    read = {".npz": read_npz, ".png": read_pixels, ".json": read_json, ".pkl": read_pickle}.get(Path(name).suffix)
    read = read or (read_mesh if name == "m.ply" else read_ply_vertices)
    tracemalloc.start()
    try:
        with pytest.raises(InputError):
            read(tmp_path / name)
        assert tracemalloc.get_traced_memory()[1] < 300 * len(content) + 10e6
    finally:
        tracemalloc.stop()
