"""A capture in another form is written in the layout of GaussianAvatars: `carigs convert IN_FOLDER OUT_FOLDER`."""

from __future__ import annotations

import argparse
import warnings
from dataclasses import replace
from pathlib import Path

from carigs.capture import Camera, Capture, read_dataset
from carigs.capture.dataset_writer import copied, linked, write_dataset
from carigs.capture.importers.calibrated_images import (
    CALIBRATIONS,
    IMAGES,
    find_calibration,
    read_calibrated_images,
)
from carigs.capture.importers.cameras import read_cameras
from carigs.capture.importers.flame_tracks import read_flame_track, read_tracked_cameras
from carigs.capture.importers.images import find_images, image_name
from carigs.capture.importers.mesh_sequence import read_mesh_sequence
from carigs.cli.parser import add_capture_options
from carigs.errors import CarigsWarning, InputError
from carigs.head import HeadModel, HeadParameters
from carigs.readers.folders import listed, natural_order

DESCRIPTION = """Write a capture in the layout of GaussianAvatars.

IN_FOLDER is a dataset in this layout (a union of sequences becomes one folder), or it holds

  images/CAMERA/TIMESTEP.png     or images/TIMESTEP_CAMERA.png; JPEG as well
  masks/...                      mattes of the same names, or none at all
  cameras.json                   or a COLMAP model in sparse/0, undistorted
  meshes/TIMESTEP.obj            one topology; or .ply
  tracked_flame_params_*.npz     of VHAP, or flame_param/TIMESTEP.npz, instead of meshes; needs --head-model

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
    if (source / "transforms_train.json").is_file():
        if options.head_model is None:
            raise InputError("a dataset needs its head model: --head-model FILE", file=source)
        capture = read_dataset(source, options.head_model, background=options.background)
        model, heads = capture.model, {timestep: capture.parameters(timestep) for timestep in capture.parameter_files}
    else:
        model, heads = _read_heads(options)
        capture = _assemble(options, set(heads))
    for line in capture.warnings:
        warnings.warn(CarigsWarning(line), stacklevel=2)
    write_dataset(options.target, capture, model, heads, place=copied if options.copy else linked)
    written = read_dataset(options.target, options.target / "head_model.npz", background=options.background)
    counts = ", ".join(f"{len(written.split(split))} {split}" for split in ("train", "val", "test"))
    print(f"{options.target}: {len(written.frames)} frames ({counts}), {len(written.cameras)} cameras")


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
    blendshapes = found.model.num_expressions
    print(f"{len(found.parameters)} meshes, {blendshapes} blendshapes, residual {1000 * found.residual:.3g} mm")
    return found.model, found.parameters
