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

from carigs.capture.dataset_writer import check_target, copied, referenced, write_dataset
from carigs.capture.importers.calibrated_images import FROM_THE_TOP
from carigs.cli.options.parser import add_capture_options, command_parser
from carigs.errors import CarigsWarning
from carigs.fitting.footage import read_footage
from carigs.fitting.landmarks.providers import find_landmarks
from carigs.fitting.principal_point import resolve_cy_by_landmarks
from carigs.fitting.residuals import outstanding_cameras
from carigs.fitting.video_fit import VideoFit, fit_video
from carigs.plausibility.principal_point import DOES_NOT_MATTER

EXAMPLES = """examples:
  carigs fit video --head-model generic_model.pkl --landmarks landmarks.npz --embedding embedding.npz -o dataset
  carigs fit video --head-model head.npz --landmarks landmarks.npz -o dataset --no-refine
  carigs fit video --cameras sparse/0 --metres-per-unit 0.1 --head-model head.npz --landmarks lmk.npz -o dataset
  carigs fit video --head-model generic_model.pkl --embedding mediapipe_landmark_embedding.npz -o dataset

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
    parser.add_argument(
        "folder",
        type=Path,
        help="transforms*.json and images; or images/, a calibration, and masks/ if there are mattes",
    )
    parser.add_argument("--head-model", type=Path, required=True, metavar="FILE", help=".npz, or FLAME's .pkl")
    parser.add_argument(
        "--landmarks",
        type=Path,
        metavar="FILE",
        help=".npz, a folder of .npz, or MediaPipe's .task (default: found as by `carigs landmarks`)",
    )
    parser.add_argument(
        "--embedding",
        type=Path,
        metavar="FILE",
        help="landmarks on the head model (default: 68: the model's own; 478: placed as by `carigs head embed`)",
    )
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DATASET", help="folder to write")
    parser.add_argument(
        "--cy",
        choices=("auto", "opencv", "flipped"),
        default="auto",
        help="whether cy counts from the top of the image (opencv) or from its bottom (default: found by landmarks)",
    )
    add_capture_options(parser)
    parser.add_argument("--no-refine", action="store_true", help="use landmarks alone, no mattes and images")
    task = parser.parse_args(arguments)
    started = time.perf_counter()
    capture = read_footage(
        task.folder,
        task.head_model,
        calibration=task.cameras,
        metres_per_unit=task.metres_per_unit,
        background=task.background,
    )
    check_target(task.output)
    landmarks = find_landmarks(task.landmarks, capture)
    capture = resolve_cy_by_landmarks(capture, landmarks, task.cy)
    if not capture.cy.endswith((DOES_NOT_MATTER, FROM_THE_TOP)):
        print(f"cy is read as {capture.cy}")
    with Progress(console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty()) as progress:
        bar = progress.add_task("fitting", total=PASSES * len(capture.parameter_files))
        fit = fit_video(
            capture, landmarks, task.embedding, refine=not task.no_refine, on_frame=lambda: progress.advance(bar)
        )
    write_dataset(task.output, capture, capture.model, fit.parameters, place=copied if task.copy else referenced)
    print(summary(fit))
    for line in (*capture.warnings, *problems(fit)):
        warnings.warn(CarigsWarning(line), stacklevel=2)
    print(f"{task.output}: {len(fit.parameters)} timesteps fitted in {time.perf_counter() - started:.1f} s")
    return 0
