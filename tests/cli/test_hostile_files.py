"""Hostile files given to the commands: one line that names the file, no code runs, and little memory is taken."""

from __future__ import annotations

import json
import pickle
import struct
import tracemalloc
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pytest
from miniature import write_ball

from carigs.cli.main import main

BYTES = 300e6
"""Most that Python and NumPy may allocate."""


class _Call:
    def __init__(self, function, *args):
        self.call = function, args

    def __reduce__(self):
        return self.call


@pytest.fixture
def ball(tmp_path) -> Path:
    return write_ball(tmp_path / "ball")


def check(ball: Path, head_model: str = "head_model.npz") -> list[str]:
    return ["check", str(ball), "--head-model", str(ball / head_model)]


def reduce_payload(ball: Path) -> tuple[list[str], str]:
    content = {"v_template": _Call(open, str(ball / "ran"), "w")}
    (ball / "head.pkl").write_bytes(pickle.dumps(content))
    return check(ball, "head.pkl"), "head.pkl: "


def numpy_global(ball: Path) -> tuple[list[str], str]:
    """`numpy.memmap(file, mode="w+")` creates a file: the names of an allowed module are dangerous, too."""
    content = {"v_template": _Call(np.memmap, str(ball / "ran"), np.uint8, "w+", 0, (9,))}
    (ball / "head.pkl").write_bytes(pickle.dumps(content))
    return check(ball, "head.pkl"), "head.pkl: "


def zip_bomb(ball: Path) -> tuple[list[str], str]:
    header = b"\x93NUMPY\x01\x00\xf6\x00" + b"{'descr': '|u1', 'fortran_order': False, 'shape': (419430400,), }"
    file = ball / "bomb.npz"
    with (
        zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("v_template.npy", "w") as member,
    ):
        member.write(header.ljust(255) + b"\n")
        for _ in range(400):
            member.write(bytes(1 << 20))
    return check(ball, "bomb.npz"), "bomb.npz: "


def lying_zip_bomb(ball: Path) -> tuple[list[str], str]:
    """The directory of the archive states 500 bytes for what unpacks to 400 MB."""
    zip_bomb(ball)
    content, size = (ball / "bomb.npz").read_bytes(), struct.pack("<I", 500)
    listed = content.rindex(b"PK\x01\x02")
    (ball / "bomb.npz").write_bytes(content[:22] + size + content[26 : listed + 24] + size + content[listed + 28 :])
    return check(ball, "bomb.npz"), "bomb.npz: v_template: not a readable .npz"


def deep_json(ball: Path) -> tuple[list[str], str]:
    (ball / "transforms_train.json").write_text('{"frames": ' + "[" * 10**6)
    return check(ball), "transforms_train.json"


def lying_ply(ball: Path) -> tuple[list[str], str]:
    header = "ply\nformat binary_little_endian 1.0\nelement vertex 2000000000\nproperty float binding_0\nend_header\n"
    (ball / "a.ply").write_bytes(header.encode() + bytes(40))
    return ["convert", str(ball / "a.ply"), str(ball / "b.ply")], "a.ply: vertex: claims 2000000000 elements"


def lying_mesh(ball: Path) -> tuple[list[str], str]:
    header = "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    header += "property float z\nelement face 1\nproperty list uint int vertex_indices\nend_header\n"
    (ball / "a.ply").write_bytes(header.encode() + bytes(36) + struct.pack("<I", 2**32 - 1))
    return ["mesh", str(ball / "a.ply"), "--gamma", "0.1", "-o", str(ball / "b.ply")], "a.ply: "


def far_path(ball: Path) -> tuple[list[str], str]:
    (ball.parent.parent / "secret.png").write_bytes((ball / "images/00000_00.png").read_bytes())
    content = json.loads((ball / "transforms_train.json").read_text())
    content["frames"][0]["file_path"] = "../../secret.png"
    (ball / "transforms_train.json").write_text(json.dumps(content))
    return check(ball), "transforms_train.json: frames[0].file_path"


def link_to_elsewhere(ball: Path) -> tuple[list[str], str]:
    """Links are followed, but only to images: the message does not quote what a link leads to."""
    (ball / "images/00000_00.png").unlink()
    (ball / "images/00000_00.png").symlink_to("/etc/passwd")
    return check(ball), "images/00000_00.png"


def huge_png(ball: Path) -> tuple[list[str], str]:
    file = ball / "images/00000_00.png"
    content = bytearray(file.read_bytes())
    content[16:24] = struct.pack(">II", 2**31 - 1, 2**31 - 1)
    content[29:33] = struct.pack(">I", zlib.crc32(content[12:29]))
    file.write_bytes(content)
    return check(ball), "images/00000_00.png"


ITEMS = (
    reduce_payload, numpy_global, pytest.param(zip_bomb, marks=pytest.mark.slow),
    pytest.param(lying_zip_bomb, marks=pytest.mark.slow), deep_json, lying_ply, lying_mesh, far_path,
    link_to_elsewhere, huge_png,
)  # fmt: skip


@pytest.mark.sample(2)
@pytest.mark.parametrize("item", ITEMS)
def test_a_hostile_file_is_named_in_a_line(item, ball, capsys):
    command, says = item(ball)
    tracemalloc.start()
    try:
        assert main(command) == 1
        assert tracemalloc.get_traced_memory()[1] < BYTES
    finally:
        tracemalloc.stop()
    printed = capsys.readouterr()
    lines = [line for line in (printed.out + printed.err).splitlines() if says in line]
    assert lines and "Traceback" not in printed.err and "root:" not in printed.out + printed.err
    assert not (ball / "ran").exists()


def test_control_characters_of_a_file_do_not_reach_the_terminal(ball, capsys):
    """Names in an index and in an archive, and the name of a file in a warning."""
    content = json.loads((ball / "transforms_train.json").read_text())
    content["frames"][0]["file_path"] = "images/\x1b[2J\nerrors: none.png"
    (ball / "transforms_train.json").write_text(json.dumps(content))
    with zipfile.ZipFile(ball / "flame_param/00001.npz", "w") as archive:
        archive.writestr("\x1b[31mv.npy", b"")
    assert main(check(ball)) == 1
    printed = capsys.readouterr()
    assert "\x1b" not in printed.out + printed.err and "\nerrors: none.png" not in printed.out
    assert r"\x1b[2J\nerrors: none.png" in printed.out and r"\x1b[31mv" in printed.out
