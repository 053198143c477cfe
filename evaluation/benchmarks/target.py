"""What a target costs, and how close it comes to a true caricature: time against error over the options of the warp.

python -m evaluation.benchmarks.target target.csv [folder of a toy capture with path.npz and capture.json]

Time: CPU ms of one thread for a frame of 802x550 and a head of 10 000 triangles.  Error: frames of the procedural
person, warped plainly (no new light), against renderings of the caricature under the same light; n x n are the samples
that say how much of a pixel the mesh covers.  And what new light brings.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path
from statistics import median

import cv2
import numpy as np

from carigs.capture import Camera, Capture
from carigs.exaggeration import GammaPath
from carigs.files import writing
from carigs.gtstar import face_mask_flags, flags_from_names, make_target
from carigs.gtstar.capture_shading import fit_capture_shading
from carigs.head import pose
from carigs.light import relight
from carigs.raster import compute_visibility
from carigs.settings import DEFAULT_MASK_FLAGS, Exaggerate, Gtstar, Toy
from carigs.settings import Capture as CaptureSettings
from carigs.stages.capture import capture
from carigs.stages.exaggerate import exaggerate
from carigs.toy import load_subject, render_subject
from evaluation.benchmarks.measurements import Measurement, write_measurements
from evaluation.metrics.regions import surface_regions

SIZE = (550, 802)
FRAMES = 6
REPEATS = 9
WRONG = 0.15
OPTIONS = tuple(product(("affine", "perspective"), (1, 2, 4), (True, False)))


def name(warp: str, samples: int, footprint: bool) -> str:
    """Of one choice of options."""
    return f"{warp}, {samples}x{samples}, footprint {'on' if footprint else 'off'}"


def cpu_ms(work: Callable[[], object]) -> float:
    """Median CPU time of the calling thread, once warm."""
    work()
    times = []
    for _ in range(REPEATS):
        start = time.thread_time()
        work()
        times.append(time.thread_time() - start)
    return 1000 * median(times)


def measure(subject: Capture, path: GammaPath) -> Iterator[Measurement]:
    """Rows of every option; the reference is the paper's: affine, one sample, no footprint."""
    model, exaggerated = subject.model, path.at(path.gamma_f)
    of_faces = face_mask_flags(model, Gtstar())
    excluded = np.uint16(flags_from_names(DEFAULT_MASK_FLAGS).value)
    frames = subject.split("test")[:: max(1, len(subject.split("test")) // FRAMES)][:FRAMES]
    person = load_subject(subject.root)
    scenes = []
    for frame in frames:
        parameters, camera = subject.parameters(frame.timestep), subject.cameras[frame.camera]
        ends = pose(model, parameters), pose(model, parameters, exaggerated)
        truth = render_subject(person, parameters, camera, exaggerated)
        scenes.append((subject.image(frame), subject.mask(frame), *ends, camera, *truth))
    image, matte, natural, caricature, camera, *_ = scenes[0]
    large = _large(camera)
    pictures = cv2.resize(image, SIZE), cv2.resize(matte, SIZE)
    scene = f"{len(model.faces)} triangles, {SIZE[1]}x{SIZE[0]}"
    yield Measurement(
        scene, "visibility at one end", "ms", cpu_ms(lambda: compute_visibility(natural, model.faces, large))
    )
    plain: dict[str, float] = {}
    for option in sorted(OPTIONS, key=lambda option: option != ("affine", 1, False)):
        settings = Gtstar(warp=option[0], supersampling=option[1], footprint=option[2])

        def one(settings: Gtstar = settings) -> object:
            ends = [compute_visibility(vertices, model.faces, large) for vertices in (natural, caricature)]
            return make_target(*pictures, *ends, model, of_faces, settings)

        numbers = {("visibility, warp and masks", "ms"): cpu_ms(one)}
        errors, left_out, wrong = [], [], []
        for *inputs, before, after, view, truth, true_matte in scenes:
            ends = [compute_visibility(vertices, model.faces, view) for vertices in (before, after)]
            target = make_target(*inputs, *ends, model, of_faces, settings)
            on_mesh, out = target.caricature.face >= 0, (target.mask_flags & excluded) > 0
            error = np.abs(target.colour - truth).mean(axis=2)
            errors.append(error[on_mesh & ~out])
            left_out.append(out[on_mesh])
            wrong.append(out[(on_mesh | (true_matte > 0)) & (error > WRONG)])
        pooled = np.concatenate(errors)
        numbers["mean absolute error", "1"] = float(pooled.mean())
        numbers["99th percentile of the error", "1"] = float(np.quantile(pooled, 0.99))
        numbers["share of the mesh's pixels that is left out", "1"] = float(np.concatenate(left_out).mean())
        numbers[f"share of the head's errors above {WRONG} that is left out", "1"] = float(np.concatenate(wrong).mean())
        for (quantity, unit), value in numbers.items():
            reference = plain.setdefault(quantity, value)
            yield Measurement(name(*option), quantity, unit, value, reference)


def relighting(subject: Capture, path: GammaPath) -> Iterator[Measurement]:
    """Rows of what new light brings at gamma and twice it: trusted pixels of the regions skin and face."""
    model, settings = subject.model, Gtstar()
    of_faces, excluded = face_mask_flags(model, settings), np.uint16(flags_from_names(DEFAULT_MASK_FLAGS).value)
    regions = {name: surface_regions(model, model.v_template).faces[name] for name in ("skin", "face")}
    person, frames = load_subject(subject.root), subject.split("test")[::2]
    shading = fit_capture_shading(settings, subject, of_faces)
    for level in (path.gamma_f, 2 * path.gamma_f):
        exaggerated = path.at(level)
        squares: dict[tuple[str, str], list[np.ndarray]] = {}
        for frame in frames:
            parameters, camera = subject.parameters(frame.timestep), subject.cameras[frame.camera]
            ends = pose(model, parameters), pose(model, parameters, exaggerated)
            pictures = subject.image(frame), subject.mask(frame)
            seen = [compute_visibility(vertices, model.faces, camera) for vertices in ends]
            target = make_target(*pictures, *seen, model, of_faces, settings, subject.background)
            truth, _ = render_subject(person, parameters, camera, exaggerated)
            factor = shading.vertex_factors(*(shading.transfer(vertices, model.faces) for vertices in ends))
            lit = relight(target.colour, target.caricature, factor, shading.kept)
            face = target.caricature.face
            trusted = (face >= 0) & ((target.mask_flags & excluded) == 0)
            for region, inside in regions.items():
                where = trusted & inside[face]
                for light, image in (("the frame's light", target.colour), ("new light", lit)):
                    squares.setdefault((region, light), []).append(((image - truth)[where] ** 2).ravel())
        for region in regions:
            reference = None
            for light in ("the frame's light", "new light"):
                value = float(-10 * np.log10(np.concatenate(squares[region, light]).mean()))
                reference = value if reference is None else reference
                yield Measurement(f"level {level:g}, {light}", f"PSNR of trusted {region}", "dB", value, reference)


def _large(camera: Camera) -> Camera:
    """The same view in an image of `SIZE`."""
    factor = SIZE[1] / camera.height
    scaled = camera.scaled(factor)
    return Camera(scaled.camera_from_world, scaled.fx, scaled.fy, 0.5 * SIZE[0], 0.5 * SIZE[1], *SIZE)


def plot(file: Path, rows: list[Measurement]) -> None:
    """Error against time, a point per option."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.2), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    for option in OPTIONS:
        values = {row.quantity: row.value for row in rows if row.case == name(*option)}
        x, y = values["visibility, warp and masks"], values["99th percentile of the error"]
        axes.plot(x, y, "os^"[option[1].bit_length() - 1], color="tab:blue" if option[0] == "perspective" else "0.6",
                  fillstyle="full" if option[2] else "none", label=name(*option))  # fmt: skip
    axes.set_xscale("log")
    axes.set_xlabel("CPU ms per frame of 802x550, one thread")
    axes.set_ylabel("99th percentile of |target - truth|, trusted pixels")
    axes.grid(alpha=0.3, which="both")
    axes.legend(fontsize=7)
    with writing(file) as part:
        figure.savefig(part, metadata={"Software": None})


def benchmark(file: Path, folder: Path | None) -> None:
    """Measure on the toy capture in `folder`, or on one made for it, and write `file` and a plot beside it."""
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory() as temporary:
        if folder is None:
            folder = Path(temporary)
            toy = CaptureSettings(toy=Toy(steps_per_sequence=1))
            capture(toy, index=folder / "capture.json", dataset=folder / "dataset")
            exaggerate(Exaggerate(), capture=folder / "capture.json", path=folder / "path.npz")
        subject = Capture.load(folder / "capture.json"), GammaPath.load(folder / "path.npz")
        rows = [*measure(*subject), *relighting(*subject)]
    write_measurements(file, rows)
    plot(file.with_suffix(".png"), rows)


if __name__ == "__main__":
    benchmark(Path(sys.argv[1]), Path(sys.argv[2]) if len(sys.argv) > 2 else None)
