"""`carigs mesh`: a mesh in, caricatures out."""

import json

import numpy as np
import pytest
import trimesh

from carigs.capture.images import read_rgb
from carigs.cli.main import main as carigs

SIDE = 360


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
    picture = read_rgb(tmp_path / "out.png")
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
        "head": ["--gamma", "0.1"],
    }.items():
        assert main([str(tmp_path / "head.stl"), *options, "-o", str(tmp_path / f"{name}.stl")]) == 0
        out = trimesh.load(tmp_path / f"{name}.stl", process=False)
        moved[name] = np.linalg.norm(out.vertices - given.vertices, axis=1)
    np.testing.assert_array_equal(moved["alone"], moved["listed"])
    assert moved["alone"][given.vertices[:, 2] < 0].max() == 0.0
    assert moved["alone"][nose].max() > 1.0
    assert moved["on_head"][nose].max() > moved["head"][nose].max() + 1.0


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
