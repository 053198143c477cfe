"""`carigs fit`: fit a head model to a calibrated video with landmarks.

The result is a dataset in the layout of GaussianAvatars, which studies read. Images and mattes stay where they are.
"""

from __future__ import annotations

import sys
import time
import warnings
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import Progress

from carigs.capture.dataset_writer import check_target, write_dataset
from carigs.cli.parser import command_parser
from carigs.errors import CarigsWarning
from carigs.fitting.footage import read_footage
from carigs.fitting.landmark_providers import find_landmarks
from carigs.fitting.residuals import outstanding_cameras
from carigs.fitting.video_fit import VideoFit, fit_video

EXAMPLES = """examples:
  carigs fit video --head-model generic_model.pkl --landmarks landmarks.npz --embedding embedding.npz -o dataset
  carigs fit video --head-model head.npz --landmarks landmarks.npz -o dataset --no-refine

docs/fitting.md describes the files.
"""

PASSES = 4
"""Passes over the frames in a refinement: two for outlines, one for means, one for images; rarely more."""


def summary(fit: VideoFit) -> str:
    """Residuals of all cameras in a line.

    Args:
        fit: The fit.

    Returns:
        The line.
    """
    cameras = ", ".join(f"{c}: {r:.2f}" for c, r in zip(fit.cameras, fit.residuals, strict=True) if np.isfinite(r))
    return f"reprojection error of the landmarks, median per camera in pixels: {cameras}"


def problems(fit: VideoFit) -> list[str]:
    """What is likely to be wrong.

    Args:
        fit: The fit.

    Returns:
        One line each.
    """
    lines = []
    for camera in outstanding_cameras(fit.residuals, fit.cameras):
        residual, usual = fit.residuals[fit.cameras.index(camera)], np.nanmedian(fit.residuals)
        text = f"camera {camera}: landmarks are {residual:.1f} pixels off, those of other cameras {usual:.1f}"
        lines.append(f"{text}; see its calibration")
    if fit.blind:
        text = ", ".join(map(str, fit.blind[:10])) + (", ..." if len(fit.blind) > 10 else "")
        lines.append(f"too few landmarks in {len(fit.blind)} timesteps, which follow their neighbours: {text}")
    return lines


def main(arguments: list[str]) -> int:
    """Run the subcommand.

    Args:
        arguments: Its command line.

    Returns:
        Exit code.
    """
    parser = command_parser("fit", __doc__, EXAMPLES)
    parser.add_argument("folder", type=Path, help="transforms.json, or transforms_{train,val,test}.json, and images")
    parser.add_argument("--head-model", type=Path, required=True, metavar="FILE", help=".npz, or FLAME's .pkl")
    parser.add_argument(
        "--landmarks", type=Path, required=True, metavar="FILE", help=".npz, a folder of .npz, or MediaPipe's .task"
    )
    parser.add_argument(
        "--embedding", type=Path, metavar="FILE", help="landmarks on the head model (default: the model's own 68)"
    )
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DATASET", help="folder to write")
    parser.add_argument(
        "--background", type=float, default=1.0, help="grey value behind the head (default %(default)s)"
    )
    parser.add_argument("--no-refine", action="store_true", help="use landmarks alone, no mattes and images")
    task = parser.parse_args(arguments)
    if not 0 <= task.background <= 1:
        parser.error(f"--background {task.background}: expected a value from 0 to 1")
    started = time.perf_counter()
    capture = read_footage(task.folder, task.head_model, background=task.background)
    check_target(task.output)
    landmarks = find_landmarks(task.landmarks, capture)
    with Progress(console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty()) as progress:
        bar = progress.add_task("fitting", total=PASSES * len(capture.parameter_files))
        fit = fit_video(
            capture, landmarks, task.embedding, refine=not task.no_refine, on_frame=lambda: progress.advance(bar)
        )
    write_dataset(task.output, capture, capture.model, fit.parameters)
    print(summary(fit))
    for line in problems(fit):
        warnings.warn(CarigsWarning(line), stacklevel=2)
    print(f"{task.output}: {len(fit.parameters)} timesteps fitted in {time.perf_counter() - started:.1f} s")
    return 0
