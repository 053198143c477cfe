"""`carigs track`: make a dataset of footage of one person: a video, videos of several cameras, or photographs.

The result is a dataset in the layout of GaussianAvatars, which studies read, with tracking.png and tracking.txt, which
say how well the head was tracked. `carigs run study=video` does the same and goes on to the avatar.
"""

from __future__ import annotations

import time
from pathlib import Path

from carigs.cli.options.parser import command_parser, grey_value
from carigs.settings import Track
from carigs.stages.track import track_and_report

EXAMPLES = """examples:
  carigs head fetch ict -o ict.npz
  carigs track me.mp4 --head-model ict.npz -o dataset
  carigs track me.mp4 --head-model ict.npz -o dataset --frame-rate 25
  carigs track left.mp4 front.mp4 right.mp4 --head-model ict.npz -o dataset
  carigs track photographs/ --head-model ict.npz -o dataset

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
    parser.add_argument(
        "recordings",
        nargs="+",
        type=Path,
        metavar="FOOTAGE",
        help="video of one person; one video or folder of frames for each camera; or a folder of photographs",
    )
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
    kinds = ("auto", "talk", "orbit", "photographs")
    text = "somebody who talks before cameras that stand still, a camera that circles, photographs of one moment"
    parser.add_argument("--footage", choices=kinds, default=defaults.footage, help=f"{text} (default: found out)")
    parser.add_argument("--held-out", choices=("blocks", "last_quarter"), default=defaults.held_out, help="test frames")
    parser.add_argument(
        "--background", type=grey_value, default=1.0, metavar="GREY", help="behind the person (default: 1, white)"
    )
    task = parser.parse_args(arguments)
    names = ("frame_rate", "largest_side", "focal_length", "footage", "held_out", "background")
    files = {name: str(file) for name in ("head_model", "embedding") if (file := getattr(task, name))}
    settings = Track(**{name: getattr(task, name) for name in names}, **files, video=str(task.recordings[0]))
    started = time.perf_counter()
    sources = task.recordings if len(task.recordings) > 1 else None
    report = track_and_report(settings, task.output, weights=task.weights, sources=sources)
    print(f"{task.output}: {report.tracked} of {report.frames} frames tracked in {time.perf_counter() - started:.0f} s")
    return 0
