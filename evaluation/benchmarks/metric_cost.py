"""Time and memory of the metrics that need networks, with random weights: the cost does not depend on their values.

256 frames of 802 x 550 pixels and their originals are embedded by CLIP ViT-B/32 and DINO ViT-S/16 for CLIP-I, CLIP-D,
CLIP-C and DINO, on two threads. Then the frames of a second level, whose originals are in the cache of embeddings, and
the first level again. Each quantity is measured in a process of its own, which starts by importing torch.

Example:
    python -m evaluation.benchmarks.metric_cost results/benchmark/metric_cost.csv
"""

from __future__ import annotations

import json
import re
import tempfile
from collections.abc import Iterator
from pathlib import Path
from time import perf_counter

import numpy as np

from carigs.capture.frame_index import RenderedImage
from carigs.capture.images import write_png
from carigs.settings import Metrics
from evaluation.benchmarks.measurement.timing import Measurement, run_in_fresh_process, write_measurements
from evaluation.command_line import csv_parser, run
from evaluation.metrics.frame_sequences import Pair
from evaluation.metrics.networks import clip, dino
from evaluation.metrics.networks.embedding_cache import EmbeddingCache
from evaluation.metrics.networks.embedding_networks import EmbeddingNetworks

FRAMES, CAMERAS, THREADS = 256, 16, 2
SIZE = (802, 550)
DINO = "dino_vits16"
LEVELS = ("original", "level 1", "level 2")
RUNS = {"all images": "level 1", "a second level, originals in the cache": "level 2", "all in the cache": "level 1"}


def write_images(folder: Path, count: int) -> None:
    """Write different images for `LEVELS`: smooth colours and a little noise, as renders have.

    Args:
        folder: Where to write them.
        count: Number of images of each level.
    """
    import cv2

    random = np.random.default_rng(0)
    for level in LEVELS:
        (folder / level).mkdir(parents=True)
        for i in range(count):
            colours = cv2.resize(random.random((6, 4, 3), np.float32), SIZE[::-1], interpolation=cv2.INTER_CUBIC)
            write_png(folder / level / f"{i}.png", colours + 0.01 * random.random(colours.shape, np.float32))


def write_weights(folder: Path) -> None:
    """Write random weights of CLIP and DINO.

    Args:
        folder: Where to write them.
    """
    import open_clip
    import timm
    from safetensors.torch import save_file

    save_file(open_clip.CLIP(**open_clip.get_model_config(clip.MODEL)).state_dict(), folder / "clip.safetensors")
    network = timm.create_model(dino.MODELS[DINO], pretrained=False, num_classes=0)
    save_file(network.state_dict(), folder / "dino.safetensors")


def score_level(folder: Path, level: str) -> dict[str, float]:
    """Compute the scores of a level and print seconds and peak memory as JSON, for a process of its own.

    Args:
        folder: Folder with images, weights and cache.
        level: One of `LEVELS`.

    Returns:
        What is printed: seconds and megabytes.
    """
    start = perf_counter()
    files = sorted((folder / level).glob("*.png"))
    pairs = [
        Pair(RenderedImage("test", i // CAMERAS, i % CAMERAS, i, file), folder / LEVELS[0] / file.name)
        for i, file in enumerate(files)
    ]
    sequences = {"test": [pairs[camera::CAMERAS] for camera in range(CAMERAS)], "orbit": []}
    networks = EmbeddingNetworks(Metrics(), 1.0, EmbeddingCache(folder / "embeddings"), THREADS)
    networks.clip_scores(folder / "clip.safetensors", sequences)
    networks.dino_scores(DINO, folder / "dino.safetensors", sequences, {"cls": "dino"})
    seconds = perf_counter() - start
    status = Path("/proc/self/status").read_text()  # of this program: getrusage counts the parent's memory, too
    measured = {"seconds": seconds, "megabytes": int(re.search(r"VmHWM:\s*(\d+)", status)[1]) / 1024}
    print(json.dumps(measured))
    return measured


def benchmark(rows: Path, frames: int = FRAMES) -> list[Measurement]:
    """Measure and write the records.

    Args:
        rows: CSV file to write.
        frames: Number of frames of a level.

    Returns:
        The records.
    """
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        write_images(folder, frames)
        code = f"from evaluation.benchmarks.metric_cost import *; write_weights(Path({temporary!r})); print('{{}}')"
        run_in_fresh_process(code)
        return write_measurements(rows, _measure(folder, frames))


def _measure(folder: Path, frames: int) -> Iterator[Measurement]:
    case = f"CLIP ViT-B/32 and DINO ViT-S/16, {frames} frames"
    for name, level in RUNS.items():
        code = f"from evaluation.benchmarks.metric_cost import *; score_level(Path({str(folder)!r}), {level!r})"
        measured = run_in_fresh_process(code)
        yield Measurement(case, name, "s", measured["seconds"])
        yield Measurement(case, f"{name}: memory", "MB", measured["megabytes"])


def main() -> None:
    """Run the benchmark from the command line."""
    benchmark(csv_parser(__doc__).parse_args().rows)


if __name__ == "__main__":
    run(main)
