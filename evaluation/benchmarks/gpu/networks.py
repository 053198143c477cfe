"""Images per second of the networks of metrics, with random weights: the cost does not depend on their values."""

from __future__ import annotations

import time
from collections.abc import Iterator

import torch

from evaluation.benchmarks.gpu.figures import Figure, Task
from evaluation.metrics.networks import clip, dino

BATCH = {"cuda": 64, "cpu": 8}
REPEATS = {"cuda": 10, "cpu": 2}
DINO = "dino_vits16"


def measure(task: Task) -> Iterator[Figure]:
    """Embed random images.

    Args:
        task: The device.

    Yields:
        Images per second of every network whose package is installed, and why others have none.
    """
    for name, make in {"CLIP ViT-B/32": _clip, "DINO ViT-S/16": _dino}.items():
        try:
            network = make().to(task.device).eval()
        except ModuleNotFoundError as error:
            yield Figure(name, "images", f"{error.name} is not installed")
            continue
        images = torch.rand(BATCH[task.device.type], 3, 224, 224, device=task.device)
        encode = getattr(network, "encode_image", network)
        with torch.no_grad():
            encode(images)
            start = time.perf_counter()
            for _ in range(REPEATS[task.device.type]):
                encode(images)
            if task.cuda:
                torch.cuda.synchronize()
        seconds = time.perf_counter() - start
        yield Figure(name, "images", REPEATS[task.device.type] * len(images) / seconds, "1/s")


def _clip() -> torch.nn.Module:
    import open_clip

    return open_clip.CLIP(**open_clip.get_model_config(clip.MODEL))


def _dino() -> torch.nn.Module:
    import timm

    return timm.create_model(dino.MODELS[DINO], pretrained=False, num_classes=0)
