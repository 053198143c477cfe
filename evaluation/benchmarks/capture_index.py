"""Time and memory of the index of a large capture, and memory of a training on it.

The capture is synthetic: 2000 timesteps x 16 cameras, a head with 2562 vertices, images of one colour that are links to
one file: tiny ones for the index, 550 x 802 pixels for the training. The training is on real frames alone and long
enough to fill its cache of images. Each quantity is measured in a process of its own.

Example:
    python -m evaluation.benchmarks.capture_index results/benchmark/capture_index.csv
"""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from carigs.capture import OPENCV_FROM_OPENGL
from carigs.capture.images import write_png
from carigs.head import HeadParameters
from evaluation.benchmarks.measurement.synthetic_scenes import moving_head, portrait
from evaluation.benchmarks.measurement.timing import Measurement, run_in_fresh_process, write_measurements
from evaluation.command_line import csv_parser, run

SIZE = (16, 24)
TRAINING_SIZE = (550, 802)
TIMESTEPS, CAMERAS, SEQUENCES = 2000, 16, 10
ITERATIONS = 2500  # 2 GiB, the limit of the cache, hold 1623 images
MEASURE = """
import json, re
from pathlib import Path
from time import perf_counter
from carigs.capture import Capture, read_dataset
from carigs.runs.outside_files import files_digest
folder = Path({folder!r})
start = perf_counter()
{work}
seconds = perf_counter() - start
status = Path("/proc/self/status").read_text()  # of this program: getrusage counts the parent's memory, too
peak = int(re.search(r"VmHWM:\\s*(\\d+)", status)[1])
print(json.dumps(dict(seconds=seconds, megabytes=peak / 1024)))
"""
WORKS = {
    "index": "read_dataset(folder, folder / 'head_model.npz').save(folder / 'capture.json')",
    "load the index": "Capture.load(folder / 'capture.json')",
    "digest": "files_digest(folder)",
}
TRAINING = """
from carigs.settings import Exaggerate, Train
from carigs.stages.exaggerate import exaggerate
from carigs.stages.train import train
capture, path = folder / "capture.json", folder / "path.npz"
read_dataset(folder, folder / 'head_model.npz').save(capture)
exaggerate(Exaggerate(), capture=capture, path=path)
outputs = dict(avatar=folder / "avatar.npz", ply=folder / "avatar.ply", log=folder / "log.csv", resume_key="")
train(Train(iterations={iterations}, gtstar_probability=0), capture=capture, path=path, targets=None, **outputs)
"""


def write_large_capture(
    folder: Path, timesteps: int = TIMESTEPS, cameras: int = CAMERAS, size: tuple[int, int] = SIZE
) -> None:
    """Write a capture of many images.

    Args:
        folder: Where to write it.
        timesteps: Number of timesteps; the last tenth is the test sequence.
        cameras: Number of cameras; camera 8 is the validation view.
        size: Width and height of the images in pixels.
    """
    for name in ("images", "fg_masks", "flame_param"):
        (folder / name).mkdir(parents=True)
    model = moving_head(4, 1).head
    model.save(folder / "head_model.npz")
    write_png(folder / "image.png", np.full((size[1], size[0], 3), 0.5))
    write_png(folder / "mask.png", np.eye(*size[::-1]))
    entries: dict[str, list[dict]] = {"train": [], "val": [], "test": []}
    rig = [portrait(*size, side) for side in np.linspace(-1.5, 1.5, cameras)]
    poses = [(camera.world_from_camera @ OPENCV_FROM_OPENGL).tolist() for camera in rig]
    for t in range(timesteps):
        parameters = f"flame_param/{t:05d}.npz"
        expression = np.zeros(model.num_expressions)
        HeadParameters(expression=expression, static_offset=np.zeros(model.v_template.shape)).save(
            folder / parameters, model
        )
        sequence = SEQUENCES * t // timesteps
        for c, camera in enumerate(rig):
            image, mask = f"images/{t:05d}_{c:02d}.png", f"fg_masks/{t:05d}_{c:02d}.png"
            os.link(folder / "image.png", folder / image)
            os.link(folder / "mask.png", folder / mask)
            split = "test" if sequence == SEQUENCES - 1 else "val" if c == 8 else "train"
            entries[split].append(
                {
                    "timestep_index": t,
                    "camera_index": c,
                    "camera_id": f"2222000{c:02d}",
                    **{"cx": camera.cx, "cy": camera.cy, "fl_x": camera.fx, "fl_y": camera.fy},
                    **{"h": camera.height, "w": camera.width},
                    "camera_angle_x": 2 * np.arctan(camera.width / 2 / camera.fx),
                    "transform_matrix": poses[c],
                    "sequence": f"EMO-{sequence}",
                    **{"file_path": image, "fg_mask_path": mask, "flame_param_path": parameters},
                }
            )
    for split, frames in entries.items():
        (folder / f"transforms_{split}.json").write_text(json.dumps({"frames": frames}, indent=4))


def benchmark(
    rows: Path, timesteps: int = TIMESTEPS, cameras: int = CAMERAS, iterations: int = ITERATIONS
) -> list[Measurement]:
    """Measure and write the records.

    Args:
        rows: CSV file to write.
        timesteps: Number of timesteps.
        cameras: Number of cameras.
        iterations: Steps of the training.

    Returns:
        The records.
    """
    with tempfile.TemporaryDirectory() as temporary:
        folder, large = Path(temporary, "capture"), Path(temporary, "large")
        write_large_capture(folder, timesteps, cameras)
        write_large_capture(large, timesteps, cameras, TRAINING_SIZE)
        return write_measurements(rows, _measure(folder, large, timesteps * cameras, iterations))


def _measure(folder: Path, large: Path, images: int, iterations: int) -> Iterator[Measurement]:
    for name, work in WORKS.items():
        yield from _time_and_memory(f"{images} images", name, folder, work)
    yield Measurement(f"{images} images", "size of the index", "MB", (folder / "capture.json").stat().st_size / 1e6)
    size = "x".join(map(str, TRAINING_SIZE))
    yield from _time_and_memory(f"{images} images of {size}", "training", large, TRAINING.format(iterations=iterations))


def _time_and_memory(case: str, name: str, folder: Path, work: str) -> Iterator[Measurement]:
    measured = run_in_fresh_process(MEASURE.format(folder=str(folder), work=work))
    yield Measurement(case, name, "s", measured["seconds"])
    yield Measurement(case, f"{name}: memory", "MB", measured["megabytes"])


def main() -> None:
    """Run the benchmark from the command line."""
    benchmark(csv_parser(__doc__).parse_args().rows)


if __name__ == "__main__":
    run(main)
