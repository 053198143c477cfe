"""SD score of table 1 (equation 10): how well Stable Diffusion predicts the noise in noisy versions of a frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float
from rich.progress import track

from carigs.capture import Capture
from carigs.capture.frame_index import RenderedImage
from carigs.capture.images import read_rgb8
from carigs.errors import InputError, WeightsMissing
from carigs.settings import Metrics
from carigs.weights.registry import registered
from carigs.weights.search import find_weights
from evaluation.metrics.networks.device import set_up_torch
from evaluation.metrics.networks.diffusion_model import encode, load_diffusion_model, predict_noise
from evaluation.tables.metric_records import MetricRecord, StudyPoint, metric_record

if TYPE_CHECKING:
    import torch

MODELS = {"sd_1.5": "stable_diffusion_1.5", "sd_2.1_base": "stable_diffusion_2.1_base"}
"""Metric of each model, and its entry in the registry of weights."""
TIMESTEPS = tuple(int(t) for t in np.round(np.linspace(20, 980, 10)))
"""From 0.02 to 0.98 of 1000 steps, the range of DreamFusion (Poole et al. 2022). The paper does not state its own, and
the score depends on it."""
SEEDS = (0, 1, 2, 3)
LATENT_SCALE = 0.18215
"""Factor of the latents in Stable Diffusion 1.5 and 2.1, as the configuration of the autoencoder states it. The score
depends on it, so tables state it, too."""
BATCH = 8


def sd_score(
    denoiser: Callable[[torch.Tensor, int], torch.Tensor],
    latents: torch.Tensor,
    timesteps: Sequence[int],
    seeds: Sequence[int],
    alphas_cumprod: Float[np.ndarray, " s"],
) -> Float[np.ndarray, " b"]:
    """SD score of images (equation 10).

        SD = 1 - mean over t, n of |eps_theta(x_t, t) - eps|^2 / |eps|^2,  x_t = sqrt(a_t) z + sqrt(1 - a_t) eps

    The noise eps depends on the timestep t and the seed n alone: all images of all methods are measured with the same
    noise, so that differences between them do not contain its randomness.

    Args:
        denoiser: Prediction eps_theta of the noise in a batch x_t (b, c, h, w) at a timestep.
        latents: Latents z of the images (b, c, h, w).
        timesteps: Timesteps t.
        seeds: Seeds n of the noise.
        alphas_cumprod: Share a_t of the image in the variance at each timestep.

    Returns:
        Score of each image: 1 if the noise is predicted exactly, 0 for a prediction of zero. The paper's is their mean.
    """
    import torch

    ratios = []
    for t in timesteps:
        share = float(alphas_cumprod[t])
        for seed in seeds:
            generator = torch.Generator().manual_seed(len(alphas_cumprod) * seed + t)
            noise = torch.randn(latents.shape[1:], generator=generator).to(latents)
            predicted = denoiser(share**0.5 * latents + (1 - share) ** 0.5 * noise, t)
            errors = (predicted - noise).double().square().sum(dim=(1, 2, 3))
            ratios.append(errors / noise.double().square().sum())
    return 1 - torch.stack(ratios).mean(dim=0).cpu().numpy()


def sd_records(
    point: StudyPoint, rendered: list[RenderedImage], subject: Capture, settings: Metrics, threads: int = 1
) -> Iterator[MetricRecord]:
    """Compute the SD score of the `test` frames with the models of `settings.diffusion`.

    Args:
        point: Avatar and level.
        rendered: Rendered frames.
        subject: The capture.
        settings: Settings of the stage `metrics`.
        threads: Threads of the networks; the result does not depend on it.

    Yields:
        One record per frame and model; one without a value for a model that cannot be used.

    Raises:
        WeightsMissing: A model or its library is missing and `settings.strict` is set.
        InputError: The files of a model are not valid.
    """
    frames = [frame for frame in rendered if frame.protocol == "test"]
    for metric in settings.diffusion:
        reason = "" if frames else "too few test frames were rendered"
        if frames:
            try:
                scores = _scores(MODELS[metric], frames, subject.background, settings, threads)
            except WeightsMissing as error:
                if settings.strict:
                    raise
                reason = str(error)
        if reason:
            yield metric_record(point, "test", (None, None), "full", metric, None, reason)
            continue
        for frame, score in zip(frames, scores, strict=True):
            yield metric_record(point, "test", (frame.camera, frame.timestep), "full", metric, float(score))


def _scores(
    name: str, frames: Sequence[RenderedImage], background: float, settings: Metrics, threads: int
) -> Float[np.ndarray, " n"]:
    folder = find_weights(registered(name), settings.weights)
    import torch

    model = load_diffusion_model(folder, set_up_torch(threads))
    if model.latent_scale != LATENT_SCALE:
        problem = f"the SD score is defined for {LATENT_SCALE}, not {model.latent_scale:g}"
        raise InputError(problem, file=folder / "vae/config.json", field="scaling_factor")
    batches = [frames[i : i + BATCH] for i in range(0, len(frames), BATCH)]
    scores = []
    for batch in track(batches, description=f"SD score, {name}", disable=len(batches) < 2):
        latents = torch.stack([encode(model, read_rgb8(frame.file), round(255 * background)) for frame in batch])
        scores.append(sd_score(partial(predict_noise, model), latents, TIMESTEPS, SEEDS, model.alphas_cumprod))
    return np.concatenate(scores)
