"""`carigs mesh`: a mesh in, caricatures out."""

import json
import os
import re
import subprocess
import sys

import numpy as np
import pytest
import trimesh

from carigs.capture.images import read_rgb
from carigs.cli.main import main as carigs
from evaluation.figures import clay

SIDE = 90
"""Of the pictures, which take most of the time otherwise."""


@pytest.fixture(autouse=True)
def small_pictures(monkeypatch):
    monkeypatch.setattr(clay, "SIZE", SIDE)


def main(arguments):
    return carigs(["mesh", *arguments])


@pytest.fixture
def mesh():
    egg = trimesh.creation.icosphere(subdivisions=3, radius=80.0)
    from_tip = np.linalg.norm(egg.vertices - [0, 0, 80], axis=1)
    nose = 12 * np.exp(-((from_tip / 17) ** 2))
    egg.vertices = egg.vertices * [1, 1.3, 1] + np.outer(nose, [0, 0, 1])
    return egg


@pytest.mark.parametrize("suffix", ["obj", "ply", "off", "glb"])
def test_level_zero_gives_the_file_back_in_every_format(mesh, tmp_path, suffix):
    file, out = tmp_path / f"head.{suffix}", tmp_path / f"out.{suffix}"
    mesh.export(file)
    assert main([str(file), "--gamma", "0", "-o", str(out)]) == 0
    before, after = (trimesh.load(f, process=False, maintain_order=True, force="mesh") for f in (file, out))
    np.testing.assert_allclose(after.vertices, before.vertices, rtol=1e-6)
    np.testing.assert_array_equal(after.faces, before.faces)


def test_stl_has_a_vertex_per_corner_and_still_holds_together(mesh, tmp_path):
    mesh.export(tmp_path / "head.stl")
    assert main([str(tmp_path / "head.stl"), "-o", str(tmp_path / "out.stl")]) == 0
    out = trimesh.load(tmp_path / "out.stl")  # merges what lies on one place
    assert out.is_watertight
    assert np.abs(out.extents - mesh.extents).max() > 1.0


def test_levels_grow_and_the_picture_has_a_row_for_each(mesh, tmp_path, capsys):
    mesh.export(tmp_path / "head.obj")
    assert main([str(tmp_path / "head.obj"), "--levels", "3", "--gamma", "0.3", "-o", str(tmp_path / "out.ply")]) == 0
    results = [trimesh.load(tmp_path / f"out_{level}.ply", process=False) for level in ("0.1", "0.2", "0.3")]
    moved = [np.linalg.norm(result.vertices - mesh.vertices, axis=1).max() for result in results]
    assert 0 < moved[0] < moved[1] < moved[2]
    picture = read_rgb(tmp_path / "out_preview.png")
    assert picture.shape == (4 * SIDE, 3 * SIDE, 3)
    assert 0.1 < (picture < 0.95).mean() < 0.6
    assert "642 vertices, 1280 faces" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("missing.obj", None, "no such mesh"),
        ("head.txt", "", "unknown kind of mesh"),
        ("points.obj", "v 0 0 0\nv 1 0 0\n", "points.obj"),
        ("broken.ply", "ply\nformat", "broken.ply"),
        ("nan.obj", "v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "vertex 0 is not finite"),
    ],
)
def test_bad_input_ends_in_one_line(tmp_path, capsys, name, content, words):
    if content is not None:
        (tmp_path / name).write_text(content)
    assert main([str(tmp_path / name), "-o", str(tmp_path / "out.ply")]) == 1
    error = capsys.readouterr().err
    assert error.startswith("carigs: ") and error.count("\n") == 1
    assert words in error
    assert not (tmp_path / "out.ply").exists()


def test_a_folder_that_is_not_there_is_named_before_work_starts(mesh, tmp_path, capsys):
    mesh.export(tmp_path / "head.obj")
    assert main([str(tmp_path / "head.obj"), "-o", str(tmp_path / "nowhere" / "out.ply")]) == 1
    said = capsys.readouterr()
    assert said.err == f"carigs: {tmp_path / 'nowhere'}: no such folder\n"
    assert said.out == ""


def test_a_region_alone_and_a_region_on_an_exaggerated_head(mesh, tmp_path):
    """At --gamma 0 the rest is held; else the region has its own level.  Regions are in the file's own vertices."""
    mesh.export(tmp_path / "head.stl")  # a vertex for every corner
    given = trimesh.load(tmp_path / "head.stl", process=False)
    nose = np.linalg.norm(given.vertices - [0, 0, 92], axis=1) < 20
    np.savez(tmp_path / "regions.npz", nose=nose)
    (tmp_path / "regions.json").write_text(json.dumps({"nose": np.flatnonzero(nose).tolist()}))
    moved = {}
    for name, options in {
        "alone": ["--gamma", "0", "--region", "nose=0.3", "--regions", str(tmp_path / "regions.npz")],
        "listed": ["--gamma", "0", "--region", "nose=0.3", "--regions", str(tmp_path / "regions.json")],
        "on_head": ["--gamma", "0.1", "--region", "nose=0.3", "--regions", str(tmp_path / "regions.npz")],
        "whole": ["--gamma", "0.1"],
    }.items():
        assert main([str(tmp_path / "head.stl"), *options, "-o", str(tmp_path / f"{name}.stl")]) == 0
        out = trimesh.load(tmp_path / f"{name}.stl", process=False)
        moved[name] = np.linalg.norm(out.vertices - given.vertices, axis=1)
    np.testing.assert_array_equal(moved["alone"], moved["listed"])
    assert moved["alone"][given.vertices[:, 2] < 0].max() == 0.0
    assert moved["alone"][nose].max() > 1.0
    assert moved["on_head"][nose].max() > moved["whole"][nose].max() + 1.0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--region", "nose=0.4"], "--region nose: give the names of regions with --regions FILE"),
        (["--region", "chin=0.4", "--regions", "r.json"], "region chin is unknown; known: nose"),
        (["--region", "nose=0.4", "--regions", "none.npz"], "none.npz: no such file"),
        (["--region", "nose=0.4", "--regions", "bad.npz"], "bad.npz: not a readable .npz"),
        (["--region", "nose=0.4", "--regions", "other.json"], "other.json: nose: the region must be a list"),
    ],
)
def test_what_is_wrong_with_regions_is_said(mesh, tmp_path, capsys, monkeypatch, options, words):
    monkeypatch.chdir(tmp_path)
    mesh.export("head.obj")
    (tmp_path / "r.json").write_text('{"nose": [1, 2]}')
    (tmp_path / "other.json").write_text('{"nose": [100000]}')
    (tmp_path / "bad.npz").write_text("nothing")
    assert main(["head.obj", *options, "-o", "out.ply"]) == 1
    assert words in capsys.readouterr().err
    assert not (tmp_path / "out.ply").exists()


@pytest.mark.parametrize("text", ["nose", "nose=", "=0.4", "nose=x", "nose=nan"])
def test_a_region_is_a_name_and_a_level(text, tmp_path, capsys):
    with pytest.raises(SystemExit):
        main(["head.obj", "--region", text, "-o", str(tmp_path / "out.ply")])
    assert "expected NAME=LEVEL" in capsys.readouterr().err


# Files that are not ours, or that must not be half-written.


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def test_a_textured_head_keeps_its_textures_and_no_other_file_is_touched(mesh, tmp_path, capsys):
    folder, elsewhere = tmp_path / "m", tmp_path / "other"
    folder.mkdir()
    elsewhere.mkdir()
    vertices = "".join(f"v {x} {y} {z}\n" for x, y, z in mesh.vertices)
    faces = "".join(f"f {a + 1}/1/1 {b + 1}/2/1 {c + 1}/3/1\n" for a, b, c in mesh.faces)
    text = f"mtllib material.mtl\n{vertices}vt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\nusemtl skin\n{faces}"
    (folder / "head.obj").write_text(text)
    (folder / "material.mtl").write_text("newmtl skin\nmap_Kd head.png\n")
    (folder / "material_0.png").write_text("the user's")
    (folder / "head.png").write_text("a texture")
    before = contents(folder)
    for out in (folder / "out.obj", elsewhere / "out.obj", folder / "head.ply"):
        assert main([str(folder / "head.obj"), "-o", str(out)]) == 0
        textures_are_lost = out.suffix == ".ply"
        assert ("without the texture coordinates" in capsys.readouterr().err) == textures_are_lost
    after = contents(folder)
    assert {name: after[name] for name in before} == before
    assert set(after) - set(before) == {"out.obj", "out_preview.png", "head.ply", "head_preview.png"}
    assert set(contents(elsewhere)) == {"out.obj", "out_preview.png"}
    files = (folder / "head.obj", folder / "out.obj", elsewhere / "out.obj")
    given, made, made_elsewhere = (file.read_text().split("\n") for file in files)
    assert "vt 1 1" in made and "usemtl skin" in made and "mtllib material.mtl" in made
    kept = [line for line in given if not line.startswith(("v ", "vn ", "f "))]
    assert [line for line in made if not line.startswith(("v ", "f "))] == kept
    corners = [line.removesuffix("/1").replace("/1 ", " ") for line in given if line.startswith("f ")]
    assert [line for line in made if line.startswith("f ")] == corners
    assert made_elsewhere[0] == "mtllib ../m/material.mtl"
    assert made_elsewhere[1:] == made[1:]


def _link(path):
    (path / "link.obj").symlink_to("head.obj")
    return "link.obj"


def _hard_link(path):
    os.link(path / "head.obj", path / "hard.obj")
    return "hard.obj"


@pytest.mark.parametrize("name", [lambda path: "head.obj", lambda path: "folder/../head.obj", _link, _hard_link])
def test_the_input_is_never_an_output(mesh, tmp_path, monkeypatch, capsys, name):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    mesh.export("head.obj")
    out = name(tmp_path)
    before = contents(tmp_path)
    assert main(["head.obj", "-o", out]) == 1
    assert capsys.readouterr().err == f"carigs: {out}: is the input head.obj; write to another file\n"
    assert contents(tmp_path) == before


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["-o", "out.obj", "--preview", "head.obj"], "head.obj: the preview is a .png"),
        (["-o", "out.obj", "--preview", "out.obj"], "out.obj: the preview is a .png"),
        (["-o", "out.obj", "--preview", "link.png"], "link.png: is the input head.obj"),
        (["-o", "out.obj", "--preview", "regions.png", "--regions", "regions.json"], "is the input regions.json"),
        (["-o", "head.obj", "--levels", "2", "--gamma", "0.2"], "head_0.1.obj: exists and is not a regular file"),
        (["-o", "folder.obj"], "folder.obj: exists and is not a regular file"),
        (["-o", "pipe.obj"], "pipe.obj: exists and is not a regular file"),
        (["-o", "out.obj", "--preview", "folder.png"], "folder.png: exists and is not a regular file"),
        (["-o", "x" * 300 + ".obj"], "cannot be written (File name too long)"),
        (["-o", "out.obj", "--gamma", "1000"], "gamma=1000: levels lie in [-100, 100]"),
        (["-o", "out.obj", "--region", "nose=-1e9", "--regions", "regions.json"], "nose=-1e+09: levels lie in"),
        (["-o", "out.obj", "--gamma", "0", "--levels", "3"], "--levels 3: the levels must differ"),
        (["-o", "out.obj", "--gamma", "1.2"], "gamma=1.2: levels outside [-1, 1] tear the surface; --force solves"),
        (["-o", "out.obj", "--gamma", "-100", "--preset", "paper", "--force"], "level 100: a weight |K|^gamma exceeds"),
        (
            ["-o", "out.obj", "--gamma", "-3", "--preset", "paper", "--force"],
            "times the size of the mesh; at most 100 is usable",
        ),
    ],
)
def test_what_cannot_be_written_is_refused_before_anything_is(mesh, tmp_path, monkeypatch, capsys, options, words):
    monkeypatch.chdir(tmp_path)
    mesh.export("head.obj")
    (tmp_path / "link.png").symlink_to("head.obj")
    (tmp_path / "regions.json").write_text('{"nose": [1, 2]}')
    (tmp_path / "regions.png").symlink_to("regions.json")
    for folder in ("folder.obj", "folder.png", "head_0.1.obj"):
        (tmp_path / folder).mkdir()
    os.mkfifo("pipe.obj")
    before = sorted(os.listdir())
    assert main(["head.obj", *options]) == 1
    error = capsys.readouterr().err
    assert error.startswith("carigs: ") and error.count("\n") == 1
    assert words in error
    assert sorted(os.listdir()) == before


def test_a_level_that_folds_the_surface_is_written_with_a_warning_if_it_is_forced(mesh, tmp_path, capsys):
    mesh.export(tmp_path / "head.obj")
    arguments = [str(tmp_path / "head.obj"), "--gamma", "3", "-o", str(tmp_path / "out.obj"), "--no-picture"]
    assert main(arguments) == 1
    assert not (tmp_path / "out.obj").exists()
    capsys.readouterr()
    assert main([*arguments, "--force"]) == 0
    (line,) = capsys.readouterr().err.splitlines()
    assert re.fullmatch("carigs: warning: level 3: the surface folds: .* % of the faces turn over.*", line)
    assert np.isfinite(trimesh.load(tmp_path / "out.obj").vertices).all()
    assert not (tmp_path / "out_preview.png").exists()


@pytest.mark.slow
def test_close_levels_have_files_of_their_own(mesh, tmp_path):
    """Three digits name steps of 0.00002 alike."""
    mesh.export(tmp_path / "head.obj")
    options = ["--gamma", "0.12342", "--levels", "50", "--preset", "paper"]
    assert main([str(tmp_path / "head.obj"), *options, "-o", str(tmp_path / "out.ply")]) == 0
    assert len(list(tmp_path.glob("out_0*.ply"))) == 50


@pytest.mark.sample(1)
@pytest.mark.parametrize(("limit", "left"), [(1000, set()), (30_000, {"out.ply"})])
def test_a_full_disk_leaves_whole_files_and_one_line(mesh, tmp_path, limit, left):
    """A limit on the size of files stands for the disk: the mesh fits or not, the picture does not."""
    mesh.export(tmp_path / "head.obj")
    program = (
        "import resource, sys\n"
        "from carigs.cli.main import main\n"
        f"resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, resource.RLIM_INFINITY))\n"
        "sys.exit(main(['mesh', 'head.obj', '-o', 'out.ply']))"
    )
    # Without bytecode: what is cut off at the limit would be read by every later process.
    done = subprocess.run([sys.executable, "-B", "-c", program], cwd=tmp_path, capture_output=True, text=True)
    file = "out_preview.png" if left else "out.ply"
    assert (done.returncode, done.stderr) == (1, f"carigs: {file}: cannot be written (File too large)\n")
    assert set(os.listdir(tmp_path)) == {"head.obj"} | left
