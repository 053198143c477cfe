"""`carigs track`: make a dataset of a video of one person.

The result is a dataset in the layout of GaussianAvatars, which studies read, with tracking.png and tracking.txt, which
say how well the head was tracked. `carigs run study=video` does the same and goes on to the avatar.
"""

from __future__ import annotations

import sys
import time
import warnings
from pathlib import Path

from rich.console import Console
from rich.progress import track as shown

from carigs.cli.parser import command_parser, grey_value
from carigs.errors import CarigsWarning
from carigs.settings import Track
from carigs.stages.track import video_options
from carigs.tracking.video import track_video

EXAMPLES = """examples:
  carigs head fetch ict -o ict.npz
  carigs track me.mp4 --head-model ict.npz -o dataset
  carigs track me.mp4 --head-model ict.npz -o dataset --frame-rate 25 --body keep

docs/recording.md says how to record such a video.
"""


def main(arguments: list[str]) -> int:
    """Run the subcommand.

    Args:
        arguments: Its command line.

    Returns:
        Exit code.
    """
    defaults = Track()
    parser = command_parser("track", __doc__, EXAMPLES)
    parser.add_argument("video", type=Path, help="one person before one camera that stands still")
    parser.add_argument("--head-model", type=Path, required=True, metavar="FILE", help=".npz, or FLAME's .pkl")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DATASET", help="folder to write")
    parser.add_argument(
        "--embedding", type=Path, metavar="FILE", help="MediaPipe's landmarks on the head model (default: found)"
    )
    parser.add_argument("--weights", type=Path, metavar="DIR", help="folder of weights that is searched first")
    for name, kind, metavar, text in (
        ("frame_rate", float, "N", "frames per second that are used, at most (default: %(default)s)"),
        ("largest_side", int, "PIXELS", "larger frames are scaled down (default: %(default)s)"),
        ("focal_length", float, "PIXELS", "of the video's frames (default: estimated)"),
    ):
        option = f"--{name.replace('_', '-')}"
        parser.add_argument(option, type=kind, default=getattr(defaults, name), metavar=metavar, help=text)
    parser.add_argument("--body", choices=("cut", "keep"), default=defaults.body, help="what is below the neck")
    parser.add_argument("--held-out", choices=("blocks", "last_quarter"), default=defaults.held_out, help="test frames")
    parser.add_argument(
        "--background", type=grey_value, default=1.0, metavar="GREY", help="behind the person (default: 1, white)"
    )
    task = parser.parse_args(arguments)
    names = ("frame_rate", "largest_side", "focal_length", "body", "held_out", "background")
    settings = Track(**{name: getattr(task, name) for name in names})
    started, console = time.perf_counter(), Console(stderr=True)
    report = track_video(
        task.video,
        task.head_model,
        task.output,
        options=video_options(settings),
        embedding=task.embedding,
        weights=task.weights,
        progress=lambda items, name, count: shown(
            items, name, count, console=console, transient=True, disable=not sys.stderr.isatty()
        ),
        status=console.status,
    )
    print(report.errors)
    print(f"focal length {report.focal_length:.0f} pixels; the guess was {report.focal_guess:.0f}")
    for line in report.advice:
        warnings.warn(CarigsWarning(line), stacklevel=2)
    print(f"{task.output}: {report.tracked} of {report.frames} frames tracked in {time.perf_counter() - started:.0f} s")
    return 0
