"""`carigs convert`: what goes in and out, and one line for everything else."""

import json
import warnings

import numpy as np
import pytest
import trimesh
from avatars import CAMERA, ball_avatar
from miniature import ball_model
from ply_oracle import FLAVOURS, GAUSSIAN_AVATARS, parse_ply, write_random_ply
from splat.formats.gltf_oracle import Gltf

from carigs.cli.main import main as carigs
from carigs.errors import CarigsWarning
from carigs.library import HeadAvatar
from carigs.motion import write_motion
from carigs.splat.avatar import load_avatar, save_avatar


def main(*arguments):
    return carigs(["convert", *map(str, arguments)])


@pytest.fixture(scope="module")
def avatar(tmp_path_factory):
    file = tmp_path_factory.mktemp("avatar") / "avatar.npz"
    made = ball_avatar()
    save_avatar(file, made)
    made.sequence.path.save(file.with_name("path.npz"))
    return file


@pytest.fixture
def trained(tmp_path):
    """Head model and parameters of a subject whose shape and offset are not 0, as GaussianAvatars writes them."""
    model = ball_model(subdivisions=2)
    model.save(tmp_path / "head_model.npz")
    rng = np.random.default_rng(3)
    sizes = {"translation": 3, "rotation": 3, "neck_pose": 3, "jaw_pose": 3, "eyes_pose": 6}
    np.savez(
        tmp_path / "flame_param.npz",
        **{name: 0.05 * rng.normal(size=(4, size)) for name, size in sizes.items()},
        shape=0.2 * np.eye(300)[0],
        expr=0.3 * np.arange(4)[:, None] * np.eye(100)[0],
        static_offset=0.0005 * rng.normal(size=(1, len(model.v_template), 3)),
        dynamic_offset=np.zeros((4, len(model.v_template), 3)),
    )
    return tmp_path, len(model.faces)


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_a_trained_avatar_comes_in_is_rendered_on_its_caricature_and_goes_out(flavour, trained):
    """The images of what went out and came in again are the same, and the caricature differs from the natural head."""
    folder, faces = trained
    write_random_ply(folder / "point_cloud.ply", FLAVOURS[flavour], faces, n=500)
    options = ["--head-model", folder / "head_model.npz"]
    parameters = ["--parameters", folder / "flame_param.npz"]
    assert main(folder / "point_cloud.ply", folder / "a.npz", *options, *parameters, "--gamma", 0.3) == 0
    first = load_avatar(folder / "a.npz")
    assert first.sequence.path.gamma_f == 0.3 and sorted(first.sequence.parameters) == [0, 1, 2, 3]
    natural, caricature = (first.render(3, level, CAMERA) for level in (0.0, 0.3))
    assert np.abs(natural - caricature).max() > 0.05
    layout = flavour.split()[0]
    out = folder / "out"
    assert main(folder / "a.npz", out / "point_cloud.ply", "--flavour", layout, *options) == 0
    parameters = ["--parameters", out / "flame_param.npz"]
    assert main(out / "point_cloud.ply", folder / "b.npz", *options, *parameters, "--gamma", 0.3) == 0
    second = load_avatar(folder / "b.npz")
    assert second.skinning == first.skinning
    np.testing.assert_allclose(second.render(3, 0.0, CAMERA), natural, atol=1e-4)
    np.testing.assert_allclose(second.render(3, 0.3, CAMERA), caricature, atol=2e-3)  # the path is solved again


def test_a_level_goes_out_as_the_static_offset(trained):
    folder, faces = trained
    write_random_ply(folder / "point_cloud.ply", GAUSSIAN_AVATARS, faces)
    options = ["--head-model", folder / "head_model.npz"]
    parameters = ["--parameters", folder / "flame_param.npz"]
    assert main(folder / "point_cloud.ply", folder / "a.npz", *options, *parameters) == 0
    out = folder / "out/point_cloud.ply"
    assert main(folder / "a.npz", out, "--flavour", "gaussian_avatars", *options, "--level", 0.25) == 0
    avatar = load_avatar(folder / "a.npz")
    with np.load(out.with_name("flame_param.npz")) as written:
        vertices = ball_model(subdivisions=2).v_template + written["static_offset"][0]
    expected = avatar.sequence.head.v_template + avatar.sequence.path.displacement(0.25)
    np.testing.assert_allclose(vertices, expected, atol=1e-7)
    assert main(folder / "a.npz", out, "--flavour", "gaussian_avatars", *options) == 1  # nothing is overwritten


def test_layouts_are_converted_without_a_head_model(trained):
    folder, faces = trained
    columns = write_random_ply(folder / "a.ply", GAUSSIAN_AVATARS, faces)
    assert main(folder / "a.ply", folder / "b.ply", "--flavour", "surfhead") == 0
    assert main(folder / "a.ply", folder / "c.ply", "--flavour", "gaussian_avatars") == 0
    assert list(parse_ply(folder / "b.ply")[0]) == FLAVOURS["surfhead without JBS"]
    order = np.argsort(columns["binding_0"], kind="stable")
    for name, values in parse_ply(folder / "c.ply")[0].items():
        np.testing.assert_allclose(values, columns[name][order], rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "flavour", "properties"),
    [("a.ply", "3dgs", 62), ("a.ply", "2dgs", 61), ("a.ply", "surfhead", 90), ("a.ply", "gaussian_avatars", 63)],
)
def test_surfels_in_every_flavour_of_ply(avatar, name, flavour, properties, tmp_path):
    assert main(avatar, tmp_path / name, "--flavour", flavour, "--level", 0.2, "--timestep", 1) == 0
    assert len(parse_ply(tmp_path / name)[0]) == properties


def test_levels_and_timesteps_reach_the_files_for_viewers(avatar, tmp_path):
    contents = set()
    for level, timestep in ((0, 0), (0.2, 0), (0.2, 2)):
        assert main(avatar, tmp_path / "a.splat", "--level", level, "--timestep", timestep) == 0
        contents.add((tmp_path / "a.splat").read_bytes())
    assert len(contents) == 3


def test_files_for_viewers_have_the_level_of_the_avatar_unless_it_is_said(avatar, tmp_path, capsys):
    sequence = load_avatar(avatar).sequence
    for options, level in (((), 0.25), (("--level", 0), 0.0)):
        assert main(avatar, tmp_path / "a.obj", *options) == 0
        assert capsys.readouterr().out.rstrip().endswith(f", level {level:g}")
        mesh = trimesh.load(tmp_path / "a.obj", process=False, maintain_order=True, force="mesh")
        np.testing.assert_allclose(mesh.vertices, sequence.posed(0, level), atol=1e-6)
        assert np.ptp(mesh.visual.vertex_colors[:, :3], axis=0).max() > 50  # the avatar's colours, not one grey


def test_an_animated_head_has_the_motions_that_are_named(avatar, tmp_path, capsys):
    own = tmp_path / "own.npz"
    write_motion(own, HeadAvatar(load_avatar(avatar)).captured_motion(10))
    for options, names in (((), ["captured"]), (("--motion", own, "--motion", "b=idle"), ["own", "b"])):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", CarigsWarning)  # a ball cannot blink
            assert main(avatar, tmp_path / "a.glb", "--flavour", "animated", *options) == 0
        gltf = Gltf(tmp_path / "a.glb")
        assert [animation["name"] for animation in gltf.document["animations"]] == names
        expected = load_avatar(avatar).sequence.posed(2, 0.25)
        np.testing.assert_allclose(gltf.vertices(names[0], 2), expected, atol=1e-5)
    capsys.readouterr()
    assert main(avatar, tmp_path / "b.glb", "--flavour", "mesh", "--motion", "idle") == 1
    assert "only --flavour animated has animations" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["a.obj", "a.ply", "a.glb"])
def test_meshes_of_an_avatar_and_of_a_path(avatar, name, tmp_path):
    sequence = load_avatar(avatar).sequence
    assert main(avatar, tmp_path / name, "--flavour", "mesh", "--level", 0.2, "--timestep", 2) == 0
    mesh = trimesh.load(tmp_path / name, process=False, maintain_order=True, force="mesh")
    np.testing.assert_allclose(mesh.vertices, sequence.posed(2, 0.2), atol=1e-6)
    assert main(avatar.with_name("path.npz"), tmp_path / name, "--flavour", "mesh", "--level", 0.2) == 0
    mesh = trimesh.load(tmp_path / name, process=False, maintain_order=True, force="mesh")
    expected = sequence.path.neutral + sequence.path.displacement(0.2)
    np.testing.assert_allclose(mesh.vertices, expected, atol=1e-6)


@pytest.mark.parametrize(("flavour", "key"), [("splats", "extensionsUsed"), ("morph_targets", "animations")])
def test_gltf_of_both_kinds(avatar, flavour, key, tmp_path):
    assert main(avatar, tmp_path / "a.gltf", "--flavour", flavour) == 0
    assert key in json.loads((tmp_path / "a.gltf").read_text())


@pytest.mark.parametrize(
    ("output", "options", "line"),
    [
        ("a.ply", [], "several flavours: --flavour gaussian_avatars or surfhead or 3dgs or 2dgs or mesh"),
        ("a.ply", ["--flavour", "splats"], "possible: gaussian_avatars, surfhead, 3dgs, 2dgs, mesh"),
        ("a.sog", [], ".sog is not possible; possible: .npz (avatar); .ply (gaussian_avatars, "),
        ("a", [], "avatar to a is not possible; possible: .npz"),
        ("a.splat", ["--level", "0.3"], "--level 0.3 lies outside the path's [0, 0.25]"),
        ("a.splat", ["--level", "-0.1"], "--level -0.1 lies outside"),
        ("a.splat", ["--level", "nan"], "--level nan lies outside"),
        ("a.splat", ["--timestep", "9"], "--timestep 9: the avatar has 3 from 0"),
    ],
)
def test_what_is_not_possible_is_one_line_that_lists_what_is(avatar, output, options, line, tmp_path, capsys):
    assert main(avatar, tmp_path / output, *options) == 1
    error = capsys.readouterr().err
    assert line in error and error.count("\n") == 1
    assert not (tmp_path / output).exists()


def test_inputs_that_are_not_converted_are_one_line(avatar, trained, capsys):
    folder, faces = trained
    columns = write_random_ply(folder / "rig.ply", GAUSSIAN_AVATARS, faces)
    write_random_ply(folder / "free.ply", GAUSSIAN_AVATARS[:-1], faces)
    np.savez(folder / "numbers.npz", a=columns["x"])
    (folder / "text.txt").write_text("text")
    out = folder / "out.npz"
    head_model = ["--head-model", folder / "head_model.npz"]
    parameters = ["--parameters", folder / "flame_param.npz"]
    for arguments, line in (
        ([folder / "nothing.npz", out], "nothing.npz: no such file"),
        ([folder / "text.txt", out], "text.txt: cannot be converted"),
        ([folder / "numbers.npz", out], "neither an avatar nor a gamma path"),
        ([folder / "free.ply", out], "binding_0"),
        ([folder / "rig.ply", out], "possible: .ply (gaussian_avatars, surfhead); with --head-model and --parameters"),
        ([folder / "rig.ply", out, *head_model], "--parameters is missing"),
        ([folder / "rig.ply", out, *parameters], "--head-model is missing"),
        ([folder / "rig.ply", out, *head_model, *parameters, "--gamma", 0], "gamma must not be 0"),
        ([avatar, avatar], "is the input"),
    ):
        assert main(*arguments) == 1
        error = capsys.readouterr().err
        assert line in error and error.count("\n") == 1, error
        assert not out.exists()


def test_surfels_of_another_head_are_refused(trained, capsys):
    """The triangles of the file must be those of the head model."""
    folder, faces = trained
    write_random_ply(folder / "a.ply", GAUSSIAN_AVATARS, 4 * faces)
    options = ["--head-model", folder / "head_model.npz", "--parameters", folder / "flame_param.npz"]
    assert main(folder / "a.ply", folder / "a.npz", *options) == 1
    assert f"binding: indices must lie in 0..{faces - 1}" in capsys.readouterr().err
    smaller = ball_model(subdivisions=1)
    smaller.save(folder / "head_model.npz")
    write_random_ply(folder / "a.ply", GAUSSIAN_AVATARS, len(smaller.faces))
    assert main(folder / "a.ply", folder / "a.npz", *options) == 1
    assert "flame_param.npz: static_offset" in capsys.readouterr().err


def test_help_shows_examples(capsys):
    with pytest.raises(SystemExit):
        main("--help")
    text = capsys.readouterr().out
    assert "carigs convert point_cloud.ply avatar.npz --head-model" in text and "--flavour 3dgs" in text


@pytest.mark.parametrize(("name", "options"), [("carigs-path-99", []), ("carigs-avatar-99", ["--flavour", "3dgs"])])
def test_a_file_of_a_newer_version_says_so_whatever_it_holds(tmp_path, capsys, name, options):
    np.savez(tmp_path / "a.npz", format=name)
    assert carigs(["convert", str(tmp_path / "a.npz"), str(tmp_path / "b.ply"), *options]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert "a newer version" in line and name in line
