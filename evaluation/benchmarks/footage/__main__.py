"""Write synthetic footage: frames or a video, mattes, and the truth.

Example:
    python -m evaluation.benchmarks.footage talk --kind talk
    python -m evaluation.benchmarks.footage ict --kind orbit --dataset ict_s1 --head-model ict_model.npz

Writes `CAMERA.mp4`, or with `--frames` `frames/CAMERA/TIMESTEP.png`; `mattes/CAMERA/TIMESTEP.png`; `truth.npz` and
`head_model.npz`, which `FootageTruth.load` reads.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from carigs.capture import read_dataset
from carigs.capture.images import write_png
from carigs.settings import Toy
from carigs.toy import make_subject
from evaluation.benchmarks.footage.backgrounds import KINDS as BACKGROUNDS
from evaluation.benchmarks.footage.backgrounds import background
from evaluation.benchmarks.footage.dataset_views import dataset_footage, dataset_person
from evaluation.benchmarks.footage.motion import Talk
from evaluation.benchmarks.footage.rendering import before, eight_bits, person
from evaluation.benchmarks.footage.scenes import KINDS
from evaluation.command_line import run


def main() -> None:
    """Write footage."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("output", type=Path, help="folder to write")
    parser.add_argument("--kind", choices=tuple(KINDS), default="talk")
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--fps", type=float, default=25.0)
    parser.add_argument("--side", type=int, default=512, help="width and height of the frames in pixels")
    parser.add_argument("--background", choices=BACKGROUNDS, default="plain")
    parser.add_argument("--hair", choices=("short", "long"), default="short")
    parser.add_argument("--seed", type=int, default=2, help="of the person and the motion")
    parser.add_argument("--frames", action="store_true", help="frames as PNG in place of a video")
    parser.add_argument("--dataset", type=Path, help="frames of this dataset in place of the toy")
    parser.add_argument("--head-model", type=Path, help="of the dataset")
    task = parser.parse_args()
    if task.dataset is None:
        subject = make_subject(Toy(seed=task.seed, supersampling=2, hair=task.hair))
        truth = KINDS[task.kind](subject.model, subject.shape, task.side, Talk(task.seconds, task.fps, seed=task.seed))
        people = [person(subject, truth, camera) for camera in range(len(truth.cameras[0]))]
    else:
        capture = read_dataset(task.dataset, task.head_model)
        truth, chosen = dataset_footage(capture, task.kind)
        people = [dataset_person(capture, chosen, camera) for camera in range(len(truth.cameras[0]))]
    truth.save(task.output)
    for camera, pictures in enumerate(people):
        first, rng = truth.cameras[0][camera], np.random.default_rng([task.seed, camera])
        behind = background(task.background, first.height, first.width, len(truth.parameters), rng)
        recorded = before(pictures, behind, seed=camera)
        frames = _with_mattes(recorded, task.output / "mattes" / str(camera))
        if task.frames:
            folder = task.output / "frames" / str(camera)
            folder.mkdir(parents=True, exist_ok=True)
            for t, frame in enumerate(frames):
                write_png(folder / f"{t:05d}.png", frame)
        else:
            _write_video(task.output / f"{camera}.mp4", frames, truth.fps)
        print(f"camera {camera}: {len(truth.parameters)} frames")


def _with_mattes(
    pictures: Iterable[tuple[UInt8[np.ndarray, "h w 3"], UInt8[np.ndarray, "h w"]]], folder: Path
) -> Iterator[Float32[np.ndarray, "h w 3"]]:
    """The frames in [0, 1]; their mattes are written on the way."""
    folder.mkdir(parents=True, exist_ok=True)
    for t, (frame, matte) in enumerate(pictures):
        write_png(folder / f"{t:05d}.png", np.float32(matte) / 255)
        yield np.float32(frame) / 255


def _write_video(file: Path, frames: Iterable[Float32[np.ndarray, "h w 3"]], fps: float) -> None:
    """MPEG-4 part 2: VP9 takes a hundred times as long for frames with noise."""
    video = None
    for frame in frames:
        if video is None:
            video = cv2.VideoWriter(str(file), cv2.VideoWriter_fourcc(*"mp4v"), fps, frame.shape[1::-1])
        video.write(np.ascontiguousarray(eight_bits(frame)[..., ::-1]))
    if video is not None:
        video.release()


if __name__ == "__main__":
    run(main)
