"""Time of the metrics that need no network, on 256 frames of 802 x 550 pixels: 16 cameras at 16 timesteps.

The frames show the procedural head with colours fixed to its surface; the rendered ones have noise on the head. One
process; OpenCV may use two threads in it.

Example:
    python -m evaluation.benchmarks.image_metric_cost results/benchmark/image_metric_cost.csv
"""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from itertools import product
from pathlib import Path
from time import perf_counter, process_time

import cv2
import numpy as np

from carigs.capture import Capture, Frame
from carigs.capture.frame_index import GroundTruth, RenderedImage
from carigs.capture.images import write_png
from carigs.capture.orbit import orbit_cameras
from carigs.exaggeration import Caricature, GammaPath
from carigs.head import neutral
from carigs.settings import Toy
from evaluation.benchmarks.measurement.timing import Measurement, write_measurements
from evaluation.benchmarks.measurement.toy_frames import SIZE, enlarged, write_subject
from evaluation.command_line import csv_parser, run
from evaluation.metrics.against_truth import truth_records
from evaluation.metrics.frame_views import FrameView, PosedMesh, frame_views
from evaluation.metrics.photo_consistency import consistency_records
from evaluation.metrics.regions import SurfaceRegions, surface_regions
from evaluation.metrics.sharpness import sharpness_records
from evaluation.tables.metric_records import MetricRecord, StudyPoint

CAMERAS, TIMESTEPS, THREADS, BAND = 16, 16, 2, 2
POINT = StudyPoint("benchmark", "toy", "noise", 0, 0.25, 0.25, "files")
SMALL = Toy(width=48, height=64, cameras=2, steps_per_sequence=1, supersampling=1, texture_size=128, hair_strands=50)
"""Only head model and parameters of this subject are used."""
PARTS: dict[str, Callable[[list[FrameView], SurfaceRegions], Iterable[MetricRecord]]] = {
    "PSNR and SSIM by region": lambda views, surface: (
        record for view in views for record in truth_records(POINT, view, surface, {}, band=BAND)
    ),
    "sharpness": lambda views, surface: (
        record for view in views for record in sharpness_records(POINT, view, surface, margin=BAND)
    ),
    "photo-consistency, of the truth, too": lambda views, surface: consistency_records(POINT, views, surface),
}
"""Records of the frames of one timestep."""


def measure_parts(
    subject: Capture, rendered: list[RenderedImage], truths: GroundTruth, caricature: Caricature
) -> Iterator[Measurement]:
    """Measure all frames, timestep by timestep.

    Args:
        subject: The capture.
        rendered: Rendered frames.
        truths: Their true images.
        caricature: Caricature that they show.

    Yields:
        CPU time of each part, and of all, and the wall-clock time.
    """
    surface = surface_regions(subject.model, neutral(subject.model, subject.parameters(rendered[0].timestep)))
    seconds: Counter[str] = Counter()

    def timed(part: str, work: Callable[[], object]) -> None:
        started = process_time()
        work()
        seconds[part] += process_time() - started

    started = perf_counter()
    for timestep in sorted({frame.timestep for frame in rendered}):
        frames = [frame for frame in rendered if frame.timestep == timestep]
        views = list(frame_views(frames, truths, subject, caricature))
        timed("reading images", lambda views=views: [(view.image8, view.truth8) for view in views])
        timed("posing and visibility", lambda views=views: [view.visibility for view in views])
        for part, records in PARTS.items():
            timed(part, lambda views=views, records=records: list(records(views, surface)))
    wall = perf_counter() - started
    case = f"{len(rendered)} frames, {SIZE[1]}x{SIZE[0]}"
    for part, value in seconds.items():
        yield Measurement(case, part, "CPU ms per frame", 1e3 * value / len(rendered))
    yield Measurement(case, "all", "CPU s", sum(seconds.values()))
    yield Measurement(case, "all", "s", wall)


def write_frames(
    folder: Path, person: Capture, caricature: Caricature, cameras: int, timesteps: int
) -> tuple[Capture, list[RenderedImage], GroundTruth]:
    """Write one true and one rendered image for each camera; all timesteps share them.

    Args:
        folder: Where to write them.
        person: Capture of the procedural subject.
        caricature: Caricature to show.
        cameras: Number of cameras.
        timesteps: Number of timesteps.

    Returns:
        A capture of these frames, the rendered frames, and the true images.
    """
    source, model, random = person.frames[0], person.model, np.random.default_rng(0)
    views = [enlarged(camera) for camera in orbit_cameras(person, cameras, 120)]
    head = PosedMesh(person, source.timestep, caricature)
    paint = (0.5 + 0.3 * np.sin(300 * model.v_template)).astype(np.float32)
    for i, camera in enumerate(views):
        seen = head.seen_by(camera).fragments
        mesh = (seen.face >= 0)[..., None]
        colours = np.einsum("hwc,hwck->hwk", seen.barycentric, paint[model.faces[seen.face]])
        write_png(folder / f"{i}.png", np.where(mesh, colours, 1))
        write_png(folder / f"{i}_render.png", np.where(mesh, colours + 0.05 * random.normal(size=colours.shape), 1))
        write_png(folder / f"{i}_mask.png", mesh[..., 0].astype(np.float32))
    keys = list(product(range(timesteps), range(cameras)))
    frames = tuple(
        Frame(t, i, "EXP-2", "test", str(folder / f"{i}.png"), str(folder / f"{i}_mask.png"), source.parameters, i)
        for t, i in keys
    )
    subject = Capture(person.root, person.head_model, frames, tuple(views), 1.0)
    rendered = [RenderedImage("test", t, i, n, folder / f"{i}_render.png") for n, (t, i) in enumerate(keys)]
    images, masks = ({key: folder / f"{key[1]}{suffix}.png" for key in keys} for suffix in ("", "_mask"))
    return subject, rendered, GroundTruth(None, images, masks)


def benchmark(file: Path, cameras: int = CAMERAS, timesteps: int = TIMESTEPS) -> None:
    """Measure, and write the records.

    Args:
        file: CSV file to write.
        cameras: Number of cameras.
        timesteps: Number of timesteps.
    """
    cv2.setNumThreads(THREADS)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        write_subject(folder, SMALL)
        person, path = Capture.load(folder / "capture.json"), GammaPath.load(folder / "path.npz")
        caricature = path.at(path.gamma_f)
        scene = write_frames(folder, person, caricature, cameras, timesteps)
        list(measure_parts(scene[0], scene[1][:cameras], scene[2], caricature))  # kernels are loaded
        write_measurements(file, measure_parts(*scene, caricature))


def main() -> None:
    """Run the benchmark from the command line."""
    benchmark(csv_parser(__doc__).parse_args().rows)


if __name__ == "__main__":
    run(main)
