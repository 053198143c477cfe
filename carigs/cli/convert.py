"""`carigs convert`: avatars, meshes and captures of other programs, in and out.

IN is an avatar (.npz), a gamma path (path.npz), a .ply file of GaussianAvatars or SurFhead, or the folder of a capture.
OUT is a file; its suffix is the format. Formats for viewers hold one timestep and one level, that of the avatar unless
--level names another one. docs/formats.md says what each format keeps.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from carigs.cli.options.motion import add_motion_options, driver_of, named_motions
from carigs.cli.options.parser import command_parser
from carigs.errors import InputError, SettingsError
from carigs.exaggeration import GammaPath
from carigs.readers.arrays import checked_text
from carigs.readers.mesh_files.ply import read_ply_vertices
from carigs.readers.npz import read_npz
from carigs.settings import DEFAULT_GAMMA

if TYPE_CHECKING:
    import numpy as np

    from carigs.splat.avatar import Avatar
    from carigs.splat.surfels.ply import SurfelPly

EXAMPLES = """examples:
  carigs convert point_cloud.ply avatar.npz --head-model flame2023.pkl --parameters flame_param.npz
      an avatar that was trained with GaussianAvatars or SurFhead, with a caricature path up to --gamma
  carigs convert avatar.npz point_cloud.ply --flavour gaussian_avatars --head-model flame2023.pkl
      back, with flame_param.npz beside it
  carigs convert avatar.npz head.ply --flavour 3dgs --level 0.2 --timestep 3
  carigs convert avatar.npz head.ply --flavour 2dgs
  carigs convert avatar.npz head.splat
  carigs convert avatar.npz head.glb --flavour splats
  carigs convert path.npz head.glb --flavour morph_targets       the path as a slider
  carigs convert avatar.npz head.glb --flavour animated --motion talk --motion take.csv
      mesh, joints, expressions and animations for Blender, three.js and game engines
  carigs convert avatar.npz head.obj --level 0.2
  carigs convert CAPTURE OUT_FOLDER
      a capture in the layout of GaussianAvatars; carigs convert CAPTURE --help lists its options
"""

RIGGED, MESH = ("gaussian_avatars", "surfhead"), ("mesh",)
GLTF = ("splats", "mesh", "morph_targets", "animated")
FLAVOURS: dict[str, dict[str, tuple[str, ...]]] = {
    "avatar": {
        ".npz": ("avatar",),
        ".ply": (*RIGGED, "3dgs", "2dgs", "mesh"),
        ".splat": ("splat",),
        ".glb": GLTF,
        ".gltf": GLTF,
        ".obj": MESH,
    },
    "surfels without a head model": {".ply": RIGGED},
    "gamma path": {".obj": MESH, ".ply": MESH, ".glb": GLTF[1:3], ".gltf": GLTF[1:3]},
}
"""What can be written, by the kind of the input and the suffix of the output."""


def convert(task: argparse.Namespace) -> float | None:
    """Read the input and write the output.

    Args:
        task: The command line.

    Returns:
        The level of exaggeration of the output; None if it has all of them or none.

    Raises:
        InputError: If a file cannot be read, or is not of a kind that is converted.
        SettingsError: If an option is missing, out of range, or names no format.
    """
    if task.output.exists() and task.output.samefile(task.input):
        raise InputError("is the input; write to another file", file=task.output)
    kind, load = _recognised(task)
    flavour = _flavour(kind, task.output, task.flavour)
    content = load()
    if kind == "avatar":
        return _write_avatar(content, flavour, task)
    if kind == "gamma path":
        level = _checked_level(content, task.level)
        _write_path(content, flavour, task.output, level)
        return level
    _write_surfels(content, flavour, task.output)
    return None


def _recognised(task: argparse.Namespace) -> tuple[str, Callable[[], Any]]:
    """Kind of the input, from its content, and the function that reads it."""
    if not task.input.exists():
        raise InputError("no such file", file=task.input)
    if task.input.suffix == ".npz":
        arrays = read_npz(task.input, only=("format", "levels"))
        stated = checked_text({"format": "", **arrays}, "format", file=task.input)
        if stated.startswith("carigs-avatar"):
            from carigs.splat.avatar import load_avatar

            return "avatar", partial(load_avatar, task.input)
        if "levels" in arrays or stated.startswith("carigs-path"):  # of another version, which says so
            return "gamma path", partial(GammaPath.load, task.input)
        raise InputError("neither an avatar nor a gamma path", file=task.input)
    if task.input.suffix.lower() != ".ply":
        raise InputError("cannot be converted: expected .npz, .ply or the folder of a capture", file=task.input)
    if "binding_0" not in read_ply_vertices(task.input).dtype.names:
        raise InputError("holds no surfels that are bound to triangles (binding_0): it has no rig", file=task.input)
    if task.head_model is None and task.parameters is None:
        from carigs.splat.surfels.ply import read_ply

        return "surfels without a head model", partial(read_ply, task.input)
    for option, value in (("--head-model", task.head_model), ("--parameters", task.parameters)):
        if value is None:
            raise SettingsError(f"a .ply becomes an avatar with --head-model and --parameters: {option} is missing")
    from carigs.splat.formats.imported_avatar import imported_avatar

    return "avatar", partial(imported_avatar, task.input, task.parameters, task.head_model, task.gamma)


def _flavour(kind: str, output: Path, wanted: str | None) -> str:
    """The flavour to write; the line of an error lists what is possible."""
    possible = FLAVOURS[kind]
    flavours = possible.get(output.suffix.lower(), ())
    if wanted in flavours:
        return wanted
    if wanted is None and len(flavours) == 1:
        return flavours[0]
    if flavours and wanted is None:
        raise SettingsError(f"{output.suffix} has several flavours: --flavour {' or '.join(flavours)}")
    if flavours:
        raise SettingsError(f"--flavour {wanted} is no {output.suffix}; possible: {', '.join(flavours)}")
    listed = "; ".join(f"{suffix} ({', '.join(names)})" for suffix, names in possible.items())
    hint = "" if kind != "surfels without a head model" else "; with --head-model and --parameters it is an avatar"
    raise SettingsError(f"{kind} to {output.suffix or output.name} is not possible; possible: {listed}{hint}")


def _write_avatar(avatar: Avatar, flavour: str, task: argparse.Namespace) -> float | None:
    from carigs.splat.avatar import save_avatar
    from carigs.splat.formats import gltf_splats, splat_files
    from carigs.splat.formats.baked_colours import baked_colours
    from carigs.splat.formats.head_meshes import level_vertices, posed_path
    from carigs.splat.formats.world_splats import bake
    from carigs.splat.surfels.ply import write_ply

    if task.motions and flavour != "animated":
        raise SettingsError("--motion: only --flavour animated has animations")
    # The other programs train and show natural heads.
    level = _checked_level(avatar.sequence.path, 0.0 if task.level is None and flavour in RIGGED else task.level)
    timesteps = sorted(avatar.sequence.parameters)
    timestep = timesteps[0] if task.timestep is None else task.timestep
    if timestep not in avatar.sequence.parameters:
        raise SettingsError(f"--timestep {timestep}: the avatar has {len(timesteps)} from {timesteps[0]}")
    if flavour == "avatar":
        save_avatar(task.output, avatar)
    elif flavour in RIGGED:
        if task.head_model is not None:
            _write_flame_param(avatar, task.head_model, task.output.with_name("flame_param.npz"), level)
        blend_weights = avatar.skinning == "jbs"
        write_ply(task.output, avatar.surfels, flavour, blend_weights=blend_weights, unrendered=avatar.unrendered)
    elif flavour in ("mesh", "morph_targets"):
        path = posed_path(avatar.sequence, timestep)
        colours = baked_colours(avatar, level_vertices(path, level))
        _write_path(path, flavour, task.output, level, colours)
    elif flavour == "animated":
        _write_animated(avatar, level, task)
    else:
        write = {
            "3dgs": splat_files.write_3dgs_ply,
            "2dgs": splat_files.write_2dgs_ply,
            "splat": splat_files.write_splat,
            "splats": gltf_splats.write_gltf_splats,
        }[flavour]
        write(task.output, bake(avatar, timestep, level))
    return None if flavour == "avatar" or (flavour in RIGGED and task.head_model is None) else level


def _write_flame_param(avatar: Avatar, head_model: Path, file: Path, level: float) -> None:
    from carigs.head import HeadModel
    from carigs.splat.formats.flame_param import write_flame_param

    if file.exists():
        raise InputError("exists; choose another folder for the output", file=file)
    write_flame_param(file, avatar.sequence, HeadModel.load(head_model), level)


def _write_animated(avatar: Avatar, level: float, task: argparse.Namespace) -> None:
    from carigs.library import HeadAvatar
    from carigs.library.animated_export import write_animated

    driver = driver_of(task)
    motions = named_motions(task.motions, task, driver, None) if task.motions else None
    write_animated(HeadAvatar(avatar), task.output, level=level, motions=motions, driver=driver)


def _write_path(path: GammaPath, flavour: str, output: Path, level: float, colours: np.ndarray | None = None) -> None:
    from carigs.splat.formats.head_meshes import write_mesh, write_morph_targets

    {"mesh": write_mesh, "morph_targets": write_morph_targets}[flavour](output, path, level, colours)


def _write_surfels(found: SurfelPly, flavour: str, output: Path) -> None:
    from carigs.splat.surfels.ply import write_ply

    write_ply(output, found.surfels, flavour, blend_weights=found.has_blend_weights, unrendered=found.unrendered)


def _checked_level(path: GammaPath, level: float | None) -> float:
    level = path.gamma_f if level is None else level
    low, high = sorted((0.0, path.gamma_f))
    if not low <= level <= high:  # also refuses NaN
        raise SettingsError(f"--level {level:g} lies outside the path's [{low:g}, {high:g}]")
    return level


def main(arguments: list[str]) -> int:
    """Run the subcommand.

    Args:
        arguments: Its command line.

    Returns:
        Exit code.
    """
    if arguments and Path(arguments[0]).is_dir():
        from carigs.cli.conversion.captures import main as convert_capture

        return convert_capture(arguments)
    parser = command_parser("convert", __doc__, EXAMPLES)
    known = sorted({name for formats in FLAVOURS.values() for names in formats.values() for name in names})
    parser.add_argument("input", type=Path, metavar="IN", help="an avatar, a path, surfels, or the folder of a capture")
    parser.add_argument("output", type=Path, metavar="OUT", help=".npz, .ply, .splat, .glb, .gltf or .obj")
    parser.add_argument("--flavour", metavar="NAME", help=f"which of a format's flavours: {', '.join(known)}")
    parser.add_argument(
        "--level", type=float, help="exaggeration (default: that of the avatar; for other trainers' formats 0)"
    )
    parser.add_argument("--timestep", type=int, help="timestep of pose and expression (default: the first)")
    parser.add_argument("--head-model", type=Path, metavar="FILE", help="head model that the .ply belongs to")
    parser.add_argument("--parameters", type=Path, metavar="FILE", help="flame_param.npz that the .ply belongs to")
    parser.add_argument(
        "--gamma", type=float, default=DEFAULT_GAMMA, help="last level of the path for a .ply (default %(default)s)"
    )
    parser.add_argument(
        "--motion", dest="motions", action="append", default=[], metavar="[NAME=]FILE",
        help="animation of --flavour animated: a motion, idle or talk (default: as captured)",
    )  # fmt: skip
    add_motion_options(parser)
    task = parser.parse_args(arguments)
    started = time.perf_counter()
    level = convert(task)
    size, seconds = task.output.stat().st_size / 1e6, time.perf_counter() - started
    print(f"{task.output}: {size:.1f} MB in {seconds:.1f} s{'' if level is None else f', level {level:g}'}")
    return 0
