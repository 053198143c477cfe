"""A capture in another form is written in the layout of GaussianAvatars: `carigs convert IN_FOLDER OUT_FOLDER`."""

from __future__ import annotations

import argparse
import sys
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import Progress

from carigs.capture import Camera, Capture, read_dataset
from carigs.capture.dataset_writer import Place, copied, linked, write_dataset
from carigs.capture.frame import Frame
from carigs.capture.image_checks import sound_images
from carigs.capture.importers.ava256 import CALIBRATION, is_ava256, read_ava256, read_calibration
from carigs.capture.importers.calibrated_images import (
    CALIBRATIONS,
    IMAGES,
    find_calibration,
    read_calibrated_images,
)
from carigs.capture.importers.cameras import read_cameras
from carigs.capture.importers.dome import import_dome
from carigs.capture.importers.flame_tracks import read_flame_track, read_tracked_cameras
from carigs.capture.importers.images import find_images, image_name
from carigs.capture.importers.mesh_sequence import MeshTrack, read_mesh_sequence
from carigs.capture.importers.multiface import is_multiface, read_multiface
from carigs.capture.importers.unpacked import UnpackedImages
from carigs.cli.options.parser import add_capture_options
from carigs.errors import CarigsWarning, InputError, SettingsError
from carigs.head import HeadModel, HeadParameters, pose
from carigs.matting.neck_cut import BELOW_CHIN, NeckCut
from carigs.mesh.triangle_mesh import boundary_vertices
from carigs.readers.folders import listed, natural_order

CAMERAS, STRIDE = 16, 8
"""Of a dome, which has up to 160 cameras and 10 000 frames: as many cameras as NeRSemble."""
DOME_OPTIONS = ("max_cameras", "stride", "neutral", "topology", "undistort")
NECK_SHARE = 0.25
"""Share of the height of a registered mesh in which its lower border lies."""

DESCRIPTION = """Write a capture in the layout of GaussianAvatars.

IN_FOLDER is a dataset in this layout (a union of sequences becomes one folder), or it holds

  images/CAMERA/TIMESTEP.png     or images/TIMESTEP_CAMERA.png; JPEG as well
  masks/...                      mattes of the same names, or none at all
  cameras.json                   or a COLMAP model in sparse/0, undistorted
  meshes/TIMESTEP.obj            one topology; or .ply
  tracked_flame_params_*.npz     of VHAP, or flame_param/TIMESTEP.npz, instead of meshes; needs --head-model

or it is a capture of Ava-256 (DATE--TIME--ID) or of Multiface (m--DATE--TIME--ID--GHS), as their downloads leave it.

docs/captures.md describes the conventions."""


def main(arguments: list[str]) -> int:
    """Run the command.

    Args:
        arguments: Command line without the name of the command.

    Returns:
        Exit code.
    """
    parser = argparse.ArgumentParser(
        "carigs convert", description=DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("source", type=Path, metavar="IN_FOLDER")
    parser.add_argument("target", type=Path, metavar="OUT_FOLDER", help="new or empty")
    parser.add_argument("--head-model", type=Path, help="file of the head model, for FLAME parameters")
    add_capture_options(parser)
    domes = parser.add_argument_group("Ava-256 and Multiface")
    domes.add_argument("--max-cameras", type=int, metavar="N", help=f"spread around the head (default {CAMERAS})")
    domes.add_argument("--stride", type=int, metavar="N", help=f"every n-th frame of a segment (default {STRIDE})")
    domes.add_argument("--neutral", type=int, metavar="FRAME", help="the neutral head (default: of a neutral segment)")
    domes.add_argument("--topology", type=Path, metavar="FILE", help="face_topology.obj of Ava-256's repository")
    domes.add_argument(
        "--undistort", action="store_true", help="apply the distortion that Ava-256's calibration states"
    )
    options = parser.parse_args(arguments)
    convert_capture(options)
    return 0


def convert_capture(options: argparse.Namespace) -> None:
    """Convert a capture, and print what was written.

    Args:
        options: The parsed command line.

    Raises:
        InputError: If something is missing or broken.
    """
    source = options.source
    place = copied if options.copy else linked
    if is_ava256(source) or is_multiface(source):
        model, heads, capture, place = _read_dome(options, place)
    elif given := [name for name in DOME_OPTIONS if getattr(options, name)]:
        option = given[0].replace("_", "-")
        raise InputError(f"--{option} is for captures of Ava-256 and Multiface; this is none", file=source)
    elif (source / "transforms_train.json").is_file():
        if options.head_model is None:
            raise InputError("a dataset needs its head model: --head-model FILE", file=source)
        capture = read_dataset(source, options.head_model, background=options.background)
        model, heads = capture.model, {timestep: capture.parameters(timestep) for timestep in capture.parameter_files}
    else:
        model, heads = _read_heads(options)
        capture = _assemble(options, set(heads))
    for line in capture.warnings:
        warnings.warn(CarigsWarning(line), stacklevel=2)
    with Progress(console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty()) as progress:
        bar = progress.add_task("images", total=len(capture.frames))

        def placed(file: Path, part: Path, folder: Path, name: str) -> str:
            progress.advance(bar)
            return place(file, part, folder, name)

        write_dataset(options.target, capture, model, heads, place=placed)
    written = read_dataset(options.target, options.target / "head_model.npz", background=options.background)
    counts = ", ".join(f"{len(written.split(split))} {split}" for split in ("train", "val", "test"))
    print(f"{options.target}: {len(written.frames)} frames ({counts}), {len(written.cameras)} cameras")


def _read_dome(
    options: argparse.Namespace, place: Place
) -> tuple[HeadModel, dict[int, HeadParameters], Capture, Place]:
    """Head model, head parameters and frames of a dome, and what happens to its images."""
    source, stride = options.source, STRIDE if options.stride is None else options.stride
    count = CAMERAS if options.max_cameras is None else options.max_cameras
    if min(stride, count) < 1:
        raise SettingsError("--stride and --max-cameras are 1 or more")
    packed = is_ava256(source)
    if not packed and (options.topology or options.undistort):
        raise SettingsError("--topology and --undistort are for Ava-256")
    dome = (
        read_ava256(source, topology=options.topology, stride=stride)
        if packed
        else read_multiface(source, stride=stride)
    )
    track, capture = import_dome(
        dome,
        options.target / "head_model.npz",
        cameras=count,
        neutral=options.neutral,
        background=options.background,
    )
    _print_track(track)
    if not packed:
        sound = sound_images(capture.root, capture.frames, capture.calibrations)
        capture = replace(capture, frames=tuple(sound.frames), warnings=sound.warnings)
        return track.model, track.parameters, capture, place
    lenses = read_calibration(dome.folder / CALIBRATION)
    if not options.undistort:
        lenses = {}
        print("lens distortion is not applied, as in the dataset's own programs; --undistort applies it")
    template, faces = track.model.v_template.astype(np.float64), track.model.faces
    border, height = np.flatnonzero(boundary_vertices(faces, len(template))), template[:, 1]
    border = border[height[border] < height.min() + NECK_SHARE * np.ptp(height)]
    cut = NeckCut(template, faces, float(height[border].mean() if border.size else height.min()) + BELOW_CHIN)

    def kept(frame: Frame) -> np.ndarray:
        return cut.kept_share(pose(track.model, track.parameters[frame.timestep]), capture.camera(frame))

    frames = {frame.image: frame for frame in capture.frames}
    unpacked = UnpackedImages(dome.folder, frames, capture.calibrations, kept, lenses)
    return track.model, track.parameters, capture, unpacked


def _print_track(track: MeshTrack) -> None:
    residual = (
        f"residual {1000 * track.mean_residual:.3g} mm (root mean square), {1000 * track.residual:.3g} mm at most"
    )
    print(f"{len(track.parameters)} meshes, {track.model.num_expressions} blendshapes, {residual}")


def _assemble(options: argparse.Namespace, timesteps: set[int]) -> Capture:
    source, model = options.source, options.target / "head_model.npz"
    calibration = options.cameras or find_calibration(source)
    if calibration is not None:
        cameras, unread = read_cameras(calibration, options.metres_per_unit)
    elif cameras := _tracked_cameras(source):
        unread = ()
    else:
        raise InputError(f"no calibration; looked for {', '.join(CALIBRATIONS)}", file=source)
    found = read_calibrated_images(source, model, cameras, timesteps=timesteps, background=options.background)
    return replace(found, warnings=(*unread, *found.warnings))


def _tracked_cameras(source: Path) -> dict[str, Camera]:
    """Cameras by the names of their images, where a tracker has moved the camera and not the head."""
    if not (source / "flame_param").is_dir():
        return {}
    images = find_images(source / IMAGES)
    tracked = read_tracked_cameras(source / "flame_param", images)
    return {
        image_name(image, source / IMAGES): tracked[image.timestep] for image in images if image.timestep in tracked
    }


def _read_heads(options: argparse.Namespace) -> tuple[HeadModel, dict[int, HeadParameters]]:
    source = options.source
    tracks = sorted(listed(source, "tracked_flame_params_*.npz"), key=natural_order)  # VHAP numbers them by epoch
    track = next((path for path in (*tracks[-1:], source / "flame_param") if path.exists()), None)
    if len(tracks) > 1:
        print(f"head parameters of {track.name}, the last of {len(tracks)} such files")
    if track is not None:
        if options.head_model is None:
            raise InputError("FLAME parameters need their head model: --head-model FILE", file=track)
        model = HeadModel.load(options.head_model)
        return model, read_flame_track(track, model)
    if not (source / "meshes").is_dir():
        problem = "no tracked head; looked for tracked_flame_params_*.npz, flame_param/ and meshes/"
        raise InputError(problem, file=source)
    found = read_mesh_sequence(source / "meshes", options.metres_per_unit)
    _print_track(found)
    return found.model, found.parameters
