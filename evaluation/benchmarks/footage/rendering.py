"""Frames of synthetic footage: the person before a background, as a camera with noise records it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from jaxtyping import Float, UInt8

from carigs.toy import ToySubject, pose_subject
from evaluation.benchmarks.footage.truth import FootageTruth

NOISE = 2.0
"""Standard deviation of the camera's noise in levels of 8 bits."""


def person(
    subject: ToySubject, truth: FootageTruth, camera: int = 0
) -> Iterator[tuple[Float[np.ndarray, "h w 3"], Float[np.ndarray, "h w"]]]:
    """Render the person as one camera sees it.

    Args:
        subject: The person.
        truth: Head and cameras.
        camera: Number of the camera.

    Yields:
        RGB over white and opacity of each timestep, in [0, 1].
    """
    posed, before = None, None
    for parameters, seen in zip(truth.parameters, truth.cameras, strict=True):
        if posed is None or parameters is not before:
            posed, before = pose_subject(subject, parameters), parameters
        yield posed.render(seen[camera])


def before(
    pictures: Iterable[tuple[Float[np.ndarray, "h w 3"], Float[np.ndarray, "h w"]]],
    backgrounds: Iterable[Float[np.ndarray, "h w 3"]],
    seed: int = 0,
) -> Iterator[tuple[UInt8[np.ndarray, "h w 3"], UInt8[np.ndarray, "h w"]]]:
    """Put a person before backgrounds, and record it.

    Args:
        pictures: RGB over white and opacity, as `person` yields them.
        backgrounds: RGB in [0, 1] of each frame, or of more.
        seed: Of the noise.

    Yields:
        Frame and matte.
    """
    rng = np.random.default_rng([seed, 0xCA3])
    for (image, alpha), behind in zip(pictures, backgrounds, strict=False):
        exact = image - (1 - alpha[..., None]) * (1 - behind)
        frame = exact + rng.normal(0, NOISE / 255, exact.shape)
        yield eight_bits(frame), eight_bits(alpha)


def eight_bits(values: Float[np.ndarray, "*n"]) -> UInt8[np.ndarray, "*n"]:
    """Round to whole levels.

    Args:
        values: From 0 to 1; others are cut off.

    Returns:
        From 0 to 255.
    """
    return np.rint(255 * values.clip(0, 1)).astype(np.uint8)
