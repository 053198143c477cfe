"""How well an image fits a posed mesh: colours at the vertices against those that other frames show there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, UInt8

from carigs.capture.corrections.colour_gains import EXPONENT, TOE
from carigs.exposure.known_median import median_of_known

NOISE = 4.0
"""Levels of 255 added to the spread of a vertex, so that none gets all the weight."""
CLIP = 40.0
"""Levels of 255 at which a difference counts as an outlier (hair, highlights) and grows no more."""
LEAST_FRAMES = 3
"""Frames that must show a vertex: with three, the median is right if one is wrong."""
LEAST_VERTICES = 50
LEVEL_TOE = np.float32(255 * TOE)
"""A factor on light is a factor on levels of 255 plus this (`carigs.capture.corrections.colour_gains`)."""


class Reference(NamedTuple):
    """Colours at the vertices, from several frames."""

    colours: Float32[np.ndarray, "*k n 3"]
    """Medians; NaN where too few frames show the vertex."""
    weights: Float32[np.ndarray, "*k n"]
    """1 / (median deviation + NOISE): vertices under hair count little."""


def sample_inside(image: UInt8[np.ndarray, "h w 3"], pixels: Float32[np.ndarray, "n 2"]) -> Float32[np.ndarray, "n 3"]:
    """Interpolate an image bilinearly.

    Args:
        image: RGB values from 0 to 255.
        pixels: Positions (x, y), pixel centres at +0.5; NaN for none.

    Returns:
        Colours from 0 to 255; NaN for positions that are NaN or not inside the image.
    """
    height, width = image.shape[:2]
    colours = np.full((len(pixels), 3), np.nan, np.float32)
    x, y = pixels.T - 0.5
    used = np.flatnonzero((x >= 0) & (y >= 0) & (x < width - 1) & (y < height - 1))
    x, y = x[used], y[used]
    column, row = x.astype(np.int64), y.astype(np.int64)
    fx, fy = (x - column)[:, None], (y - row)[:, None]
    flat, first = image.reshape(-1, 3), row * width + column
    top = (1 - fx) * flat[first] + fx * flat[first + 1]
    bottom = (1 - fx) * flat[first + width] + fx * flat[first + width + 1]
    colours[used] = (1 - fy) * top + fy * bottom
    return colours


def reference(samples: Float32[np.ndarray, "m *k n 3"]) -> Reference:
    """Median colour of each vertex over frames.

    Args:
        samples: Colours of m frames; NaN where the vertex is hidden.

    Returns:
        The reference.
    """
    colours = median_of_known(samples)
    spread = median_of_known(np.abs(samples - colours).mean(axis=-1))
    colours[np.isfinite(samples[..., 0]).sum(axis=0) < LEAST_FRAMES] = np.nan
    return Reference(colours, 1 / (spread + NOISE))


def misfit(samples: Float32[np.ndarray, "n 3"], expected: Reference) -> float:
    """Weighted mean of the differences of an image from a reference.

    Args:
        samples: Colours of the image.
        expected: The reference.

    Returns:
        Levels of 255; NaN if the two share fewer than `LEAST_VERTICES` vertices.
    """
    difference = np.minimum(np.abs(samples - expected.colours).mean(axis=-1), CLIP)
    shared = np.isfinite(difference)
    if shared.sum() < LEAST_VERTICES:
        return float("nan")
    return float(np.average(difference[shared], weights=expected.weights[shared]))


def with_light_of(
    samples: Float32[np.ndarray, "n 3"], expected: Reference
) -> tuple[Float32[np.ndarray, "n 3"], Float32[np.ndarray, "3"]]:
    """Match exposure and white balance of an image to a reference.

    Args:
        samples: Colours of the image.
        expected: The reference.

    Returns:
        The colours with the light of the reference; and the light of the image as a ratio of that of the reference in
        red, green and blue. Medians over the vertices; NaN without a common vertex.
    """
    factor = median_of_known((expected.colours + LEVEL_TOE) / (samples + LEVEL_TOE))
    return factor * (samples + LEVEL_TOE) - LEVEL_TOE, factor**-EXPONENT


def disagreement(samples: Float32[np.ndarray, "m n 3"]) -> float:
    """Mean misfit of frames to their own median.

    Args:
        samples: Colours of m frames; NaN where the vertex is hidden.

    Returns:
        Levels of 255, all vertices weighted equally; NaN if no frame shares enough vertices with others.
    """
    expected = reference(samples)
    misfits = [misfit(colours, expected._replace(weights=np.ones_like(expected.weights))) for colours in samples]
    known = [value for value in misfits if np.isfinite(value)]
    return float(np.mean(known)) if known else float("nan")
