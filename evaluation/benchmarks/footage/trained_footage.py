"""What tracking and mattes cost an avatar of footage: trainings with them, and with the truth in their places.

The procedural person talks before a bookshelf and one camera. Three datasets of the same frames are trained on with the
settings of `study=video`: head, camera and mattes as `carigs track` finds them (landmarks with the errors of a
network); the true head and camera, with these mattes; and all true. Held-out frames are rendered with the head and the
camera of each dataset, and compared with the true images without background: the person at level 0, and the true
caricature at .25. Images end below the chin, as with `capture.body=cut`.

Example:
    python -m evaluation.benchmarks.footage.trained_footage rows.csv
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from carigs.capture import Capture, Frame, read_dataset
from carigs.capture.dataset_writer import copied, parameter_file, write_dataset
from carigs.capture.images import write_png
from carigs.capture.splits import blocks
from carigs.config import load_settings
from carigs.config.frozen import settings_text
from carigs.detection.person import PersonSegmenter, load_person_segmenter
from carigs.embedding import landmark_embedding
from carigs.exaggeration import Caricature
from carigs.head import neutral, pose
from carigs.matting import MattedFrame, composite
from carigs.matting.cut_dataset import write_cut_dataset
from carigs.matting.mattes import given_mattes
from carigs.matting.neck_cut import NeckCut
from carigs.raster import rasterize_mesh
from carigs.settings import Gtstar, Section, Track, Train
from carigs.simd.threads import use_threads
from carigs.splat.avatar import Avatar
from carigs.toy import ToySubject, render_subject
from carigs.tracking.dataset import write_tracked_dataset
from carigs.tracking.video import person_mattes
from evaluation.benchmarks.footage.motion import Talk
from evaluation.benchmarks.footage.oracle_recordings import SEED, Filmed, filmed_toy, oracle_recordings, toy_subject
from evaluation.benchmarks.footage.tracked_heads import tracked
from evaluation.benchmarks.measurement.timing import Measurement, write_measurements
from evaluation.benchmarks.measurement.toy_frames import write_index_and_path
from evaluation.benchmarks.measurement.toy_training import (
    BAND,
    HeldOutView,
    in_eight_bits,
    inputs_of,
    psnr_by_region,
    train_avatar,
)
from evaluation.command_line import csv_parser, run
from evaluation.metrics.regions import image_regions, surface_regions

TRACKED, MADE, TRUE = "tracked head, made mattes", "true head, made mattes", "true head, true mattes"
LEVELS = (0.0, 0.25)
REGIONS = ("person", "face", "hair", "silhouette")


class Trained(NamedTuple):
    """An avatar of a dataset."""

    avatar: Avatar
    capture: Capture
    caricature: Caricature
    """That of the dataset's head at the level .25."""


def study_settings(section: str, folder: Path) -> Section:
    """Settings of the variant that `study=video` trains.

    Args:
        section: Name of the stage.
        folder: Where to write them.

    Returns:
        The settings.
    """
    file = folder / f"{section}.yaml"
    footage = "capture.video=video.mp4", "capture.head_model=head.npz"  # neither is read
    text = settings_text(section, "study=video", "subject=video", "variant=alternating", *footage)
    file.write_text(text, "utf-8")
    return load_settings(section, file)


def write_true_dataset(folder: Path, filmed: Filmed, matted: Sequence[MattedFrame], cut: NeckCut) -> None:
    """Write footage of one camera as a dataset with the true head and camera.

    Args:
        folder: Folder to create.
        filmed: The footage.
        matted: Its frames with mattes.
        cut: Where mattes end.
    """
    truth, names = filmed.truth, blocks(len(matted))
    camera, heads = truth.cameras[0][0], truth.vertices()
    with TemporaryDirectory() as part:
        frames = []
        for t, (_, alpha, foreground) in enumerate(matted):
            kept = alpha * cut.kept_share(heads[t], camera)
            write_png(Path(part) / f"{t:05d}.png", composite(foreground, kept, 1.0) / 255.0)
            write_png(Path(part) / f"{t:05d}_matte.png", kept)
            files = f"{t:05d}.png", f"{t:05d}_matte.png", parameter_file(t)
            frames.append(Frame(t, 0, "", names[t], *files, 0))
        capture = Capture(Path(part), Path("head_model.npz"), tuple(frames), (camera,), 1.0)
        write_dataset(folder, capture, truth.model, dict(enumerate(truth.parameters)), place=copied)


def true_views(
    subject: ToySubject, filmed: Filmed, cut: NeckCut, frames: Sequence[Frame], caricature: Caricature
) -> list[HeldOutView]:
    """Images of the true person without background.

    Args:
        subject: The person.
        filmed: The footage.
        cut: Where images end.
        frames: Those of a dataset that are compared.
        caricature: The true one at the level of the images.

    Returns:
        The frames with regions; `person` is where alpha is above 0.5.
    """
    truth, views = filmed.truth, []
    surface = surface_regions(truth.model, neutral(truth.model, truth.parameters[0]))
    for frame in frames:
        parameters, camera = truth.parameters[frame.timestep], truth.cameras[frame.timestep][0]
        image, alpha = render_subject(subject, parameters, camera, caricature)
        head = pose(truth.model, parameters, caricature)
        kept = cut.kept_share(head, camera)
        person = alpha * kept > 0.5
        regions = image_regions(
            surface, head, rasterize_mesh(head, truth.model.faces, camera), camera, person, band=BAND
        )
        regions = {name: region & (kept > 0.5) for name, region in (regions | {"person": person}).items()}
        views.append(HeldOutView(frame, camera, in_eight_bits(1 - kept[..., None] * (1 - image)), regions))
    return views


def measure(
    folder: Path, filmed: Filmed, subject: ToySubject, segmenter: PersonSegmenter, train: Train, gtstar: Gtstar
) -> Iterator[Measurement]:
    """Train avatars on footage of the procedural person, and compare them with the truth.

    Args:
        folder: Empty folder for the datasets.
        filmed: The footage, of one camera.
        subject: The person.
        segmenter: Finds people.
        train: Settings of the trainings.
        gtstar: Settings of their targets.

    Yields:
        PSNR of held-out frames by dataset, level and region.
    """
    truth = filmed.truth
    [recording] = oracle_recordings(filmed)
    embedding = landmark_embedding(truth.model)
    points = embedding.points(truth.model)
    track = tracked([recording], truth.model, "talk")
    assert len(track.kept) == len(truth.parameters)
    with threadpool_limits(1, "blas"):
        made = [*person_mattes(recording, track.kept, segmenter)]
        given = [*given_mattes(recording.footage, lambda frame: filmed.mattes[0][frame.number] / 255)]
        rest = neutral(truth.model, truth.parameters[0])
        cut = NeckCut(rest, truth.model.faces, float(points.interpolate(rest)[:, 1].min()))
        whole, known = folder / "tracked", {"landmarks": points, "numbers": embedding.landmarks}
        write_tracked_dataset(whole, track, [recording], made, background=1.0, **known)
        write_cut_dataset(folder / TRACKED, read_dataset(whole, whole / "head_model.npz"))
    write_true_dataset(folder / MADE, filmed, made, cut)
    write_true_dataset(folder / TRUE, filmed, given, cut)
    avatars = {name: trained(folder / name, train, gtstar) for name in (TRUE, MADE, TRACKED)}
    still = Caricature(np.zeros(truth.model.v_template.shape))
    test = avatars[TRUE].capture.split("test")
    for level, caricature in zip(LEVELS, (still, avatars[TRUE].caricature), strict=True):
        views = true_views(subject, filmed, cut, test, caricature)
        for name, (avatar, capture, _) in avatars.items():
            [camera] = capture.cameras.values()
            values = psnr_by_region(avatar, level, [view._replace(camera=camera) for view in views])
            for region in REGIONS:
                yield Measurement(f"{name}, level {level:g}", f"PSNR of {region}", "dB", values[region])


def trained(dataset: Path, train: Train, gtstar: Gtstar) -> Trained:
    """Train an avatar on a dataset, as a study does.

    Args:
        dataset: The dataset; a folder is made beside it.
        train: Settings of the training.
        gtstar: Settings of its targets.

    Returns:
        The avatar.
    """
    work = dataset.with_name(f"{dataset.name}, work")
    work.mkdir()
    write_index_and_path(work, dataset, dataset / "head_model.npz")
    inputs = inputs_of(work, gtstar)
    return Trained(train_avatar(inputs, train), inputs.capture, inputs.path.at(LEVELS[1]))


def main() -> None:
    """Run the benchmark from the command line."""
    parser = csv_parser(__doc__)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--background", default="books")
    parser.add_argument("--steps", type=int, help="of each training (default: those of study=video)")
    task = parser.parse_args()
    use_threads(1)
    subject = toy_subject()
    filmed = filmed_toy(subject, "talk", Talk(task.seconds, Track().frame_rate, seed=SEED), behind=task.background)
    with TemporaryDirectory() as folder:
        train, gtstar = (study_settings(name, Path(folder)) for name in ("train", "gtstar"))
        if task.steps:
            train = replace(train, iterations=task.steps, density=replace(train.density, stop=task.steps // 2))
        write_measurements(task.rows, measure(Path(folder), filmed, subject, load_person_segmenter(), train, gtstar))


if __name__ == "__main__":
    run(main)
