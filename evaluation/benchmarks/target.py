"""Time and error of GT* targets over the options of the warp, and the gain of relighting.

Time: CPU ms of one thread for a frame of 802x550. Error: test frames of the procedural subject, warped without
relighting, against renderings of its caricature under the same light. n x n is the supersampling of outline pixels.

Example:
    python -m evaluation.benchmarks.target results/benchmark/target.csv
"""

from __future__ import annotations

import tempfile
from collections import defaultdict
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import chain, product
from pathlib import Path

import cv2
import numpy as np

from carigs.capture import Camera, Capture, Frame, read_dataset
from carigs.exaggeration import Caricature, GammaPath
from carigs.gtstar import Target, face_mask_flags, flags_from_names, make_target
from carigs.gtstar.capture_shading import fit_capture_shading
from carigs.head import neutral, pose, subject_gamma_path
from carigs.head.teeth import add_teeth
from carigs.light import relight
from carigs.raster import compute_visibility
from carigs.settings import DEFAULT_MASK_FLAGS, Exaggerate, Gtstar, Toy
from carigs.toy import load_subject, render_subject, write_capture
from evaluation.benchmarks.plots import plot_target
from evaluation.benchmarks.timing import Measurement, cpu_seconds, median_time, write_measurements
from evaluation.command_line import csv_parser, run
from evaluation.figures.misregistration import ERROR_THRESHOLD
from evaluation.metrics.image_quality import psnr_of_errors, squared_error
from evaluation.metrics.regions import surface_regions

SIZE = (550, 802)
FRAMES = 6
REPEATS = 9
LIGHTS = ("the frame's light", "new light")
OPTIONS = tuple(product(("affine", "perspective"), (1, 2, 4), (True, False)))
"""Values of `gtstar.warp`, `gtstar.supersampling` and `gtstar.antialias`."""


def measure_warp(subject: Capture, path: GammaPath, repeats: int = REPEATS) -> Iterator[Measurement]:
    """Measure time and error of targets at gamma_f for each of `OPTIONS`.

    Args:
        subject: Capture of the procedural subject.
        path: Its caricature path.
        repeats: Number of timed calls.

    Yields:
        Records; the reference is the paper's warp: affine, one sample, no antialiasing.
    """
    model, exaggerated = subject.model, path.at(path.gamma_f)
    face_flags = face_mask_flags(model, Gtstar())
    excluded = np.uint16(flags_from_names(DEFAULT_MASK_FLAGS).value)
    frames = subject.split("test")[:: max(1, len(subject.split("test")) // FRAMES)][:FRAMES]
    scenes = _scenes(subject, frames, exaggerated)
    image, matte, *meshes, camera, _, _ = scenes[0]
    large = (cv2.resize(image, SIZE), cv2.resize(matte, SIZE), *meshes, enlarged(camera))
    scene = f"{len(model.faces)} triangles, {SIZE[1]}x{SIZE[0]}"
    seconds = median_time(lambda: compute_visibility(meshes[0], model.faces, large[-1]), repeats, cpu_seconds)
    yield Measurement(scene, "visibility at one end", "ms", 1e3 * seconds)
    references: dict[str, float] = {}
    for option in sorted(OPTIONS, key=lambda option: option != ("affine", 1, False)):
        warp, samples, antialias = option
        settings = Gtstar(warp=warp, supersampling=samples, antialias=antialias)
        make_one = partial(_target, subject, face_flags, settings)
        seconds, pixels = median_time(lambda make=make_one: make(*large), repeats, cpu_seconds), []
        for *scene, truth, true_matte in scenes:
            target = make_one(*scene)
            error = np.abs(target.colour - truth).mean(axis=2)
            pixels.append((error, target.caricature.face >= 0, (target.mask_flags & excluded) > 0, true_matte > 0))
        error, on_mesh, left_out, head = map(np.stack, zip(*pixels, strict=True))
        trusted, wrong = error[on_mesh & ~left_out], (on_mesh | head) & (error > ERROR_THRESHOLD)
        values = {
            "visibility, warp and masks": 1e3 * seconds,
            "mean absolute error": trusted.mean(),
            "99th percentile of the error": np.quantile(trusted, 0.99),
            "share of the mesh's pixels that is left out": left_out[on_mesh].mean(),
            f"share of the head's errors above {ERROR_THRESHOLD} that is left out": left_out[wrong].mean(),
        }
        case = f"{warp}, {samples}x{samples}, antialias {'on' if antialias else 'off'}"
        for unit, (quantity, value) in zip(("ms", "1", "1", "1", "1"), values.items(), strict=True):
            yield Measurement(case, quantity, unit, float(value), references.setdefault(quantity, float(value)))


def measure_relighting(subject: Capture, path: GammaPath) -> Iterator[Measurement]:
    """Measure PSNR of trusted pixels of targets before and after relighting, at gamma_f and twice that level.

    Args:
        subject: Capture of the procedural subject.
        path: Its caricature path.

    Yields:
        Records for the regions skin and face; the reference is the value in the light of the frame.
    """
    model, settings = subject.model, Gtstar()
    face_flags, excluded = face_mask_flags(model, settings), np.uint16(flags_from_names(DEFAULT_MASK_FLAGS).value)
    regions = {name: surface_regions(model, model.v_template).faces[name] for name in ("skin", "face")}
    shading = fit_capture_shading(settings, subject, face_flags)
    for level in (path.gamma_f, 2 * path.gamma_f):
        squares: dict[tuple[str, str], list[np.ndarray]] = defaultdict(list)
        for *scene, truth, _ in _scenes(subject, subject.split("test")[::2], path.at(level)):
            target = _target(subject, face_flags, settings, *scene)
            factor = shading.vertex_factors(*(shading.transfer(vertices, model.faces) for vertices in scene[2:4]))
            relit = relight(target.colour, target.caricature, factor, shading.kept)
            face = target.caricature.face
            trusted = (face >= 0) & ((target.mask_flags & excluded) == 0)
            for region, inside in regions.items():
                for light, image in zip(LIGHTS, (target.colour, relit), strict=True):
                    squares[region, light].append(squared_error(image, truth)[trusted & inside[face]])
        values = {key: psnr_of_errors(np.concatenate(parts)) for key, parts in squares.items()}
        for (region, light), value in values.items():
            case, reference = f"level {level:g}, {light}", values[region, LIGHTS[0]]
            yield Measurement(case, f"PSNR of trusted {region}", "dB", value, reference)


def benchmark(file: Path, folder: Path | None = None, toy: Toy | None = None, repeats: int = REPEATS) -> None:
    """Measure, and write the records and their plot.

    Args:
        file: CSV file to write; the plot goes beside it.
        folder: Folder with `capture.json` and `path.npz` of a procedural subject; None to make one.
        toy: Settings of the subject to make.
        repeats: Number of timed calls.
    """
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory() as temporary:
        if folder is None:
            folder = Path(temporary)
            write_subject(folder, toy or Toy(steps_per_sequence=1))
        subject, path = Capture.load(folder / "capture.json"), GammaPath.load(folder / "path.npz")
        measurements = chain(measure_warp(subject, path, repeats), measure_relighting(subject, path))
        plot_target(file.with_suffix(".png"), write_measurements(file, measurements))


def _scenes(subject: Capture, frames: Sequence[Frame], exaggerated: Caricature) -> list[tuple]:
    """Image, matte, natural and caricature mesh, camera, true caricature and its matte, of each frame."""
    person, model, scenes = load_subject(subject.root), subject.model, []
    for frame in frames:
        parameters, camera = subject.parameters(frame.timestep), subject.camera(frame)
        meshes = pose(model, parameters), pose(model, parameters, exaggerated)
        truth = render_subject(person, parameters, camera, exaggerated)
        scenes.append((subject.image(frame), subject.foreground(frame), *meshes, camera, *truth))
    return scenes


def _target(
    subject: Capture, face_flags: np.ndarray, settings: Gtstar, image: np.ndarray, matte: np.ndarray,
    natural: np.ndarray, deformed: np.ndarray, camera: Camera,
) -> Target:  # fmt: skip
    """Warp a frame from the natural mesh to that of the caricature."""
    ends = [compute_visibility(vertices, subject.model.faces, camera) for vertices in (natural, deformed)]
    return make_target(image, matte, *ends, subject.model, face_flags, settings, subject.background)


def write_subject(folder: Path, toy: Toy, exaggerate: Exaggerate | None = None) -> None:
    """Write a capture of the procedural subject and its path, as the stages `capture` and `exaggerate` do.

    Args:
        folder: Folder for `capture.json`, `path.npz` and the dataset.
        toy: Settings of the subject.
        exaggerate: Settings of the path; None for the defaults.
    """
    write_capture(folder / "dataset", toy)
    read_dataset(folder / "dataset", folder / "dataset/head_model.npz").save(folder / "capture.json")
    subject = Capture.load(folder / "capture.json")
    parameters = [subject.parameters(t) for t in dict.fromkeys(frame.timestep for frame in subject.frames)]
    vertices = neutral(subject.model, parameters[0])
    path = subject_gamma_path(subject.model, vertices, exaggerate or Exaggerate(), parameters)
    add_teeth(path, vertices, subject.model.faces).save(folder / "path.npz")


def enlarged(camera: Camera) -> Camera:
    """Change the resolution of a camera.

    Args:
        camera: The camera.

    Returns:
        The same view in an image of `SIZE`.
    """
    scaled = camera.scaled(SIZE[1] / camera.height)
    return Camera(scaled.camera_from_world, scaled.fx, scaled.fy, 0.5 * SIZE[0], 0.5 * SIZE[1], *SIZE)


def main() -> None:
    """Run the benchmark from the command line."""
    parser = csv_parser(__doc__)
    parser.add_argument("folder", type=Path, nargs="?", help="with capture.json and path.npz of a procedural subject")
    arguments = parser.parse_args()
    benchmark(arguments.rows, arguments.folder)


if __name__ == "__main__":
    run(main)
