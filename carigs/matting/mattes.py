"""Mattes of a clip: from coarse mattes, or from a plain background alone."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sized
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8

from carigs.errors import CarigsError
from carigs.footage.footage import TimedFrame
from carigs.matting.background import Background, clean_plate, distance_from, plain_background
from carigs.matting.closed_form import closed_form_alpha
from carigs.matting.colour_model import with_colours
from carigs.matting.difference import difference_prior
from carigs.matting.foreground import foreground_colours
from carigs.matting.steadiness import ImageMotion, Motion, SteadyMatte
from carigs.matting.trimap import BACKGROUND, DIFFERENT, OUTWARD, grown, in_pixels, trimap
from carigs.system.in_order import in_order

PRIOR_WEIGHT = 1e-4
"""Weight of the difference matte against the matting Laplacian, for a variance of 1."""
COARSE_WEIGHT = 1e-3
"""Weight in the band of the coarse matte and the colour model, where the known background says nothing."""
PLATE_MARGIN = 1.0
"""Distance from a coarse outline from which a pixel counts as background, in widths of the trimap's band."""


COARSE_SHARE, ALPHA_SHARE = 0.7, 0.4
"""Weights of the frame before in the coarse and in the refined matte."""
PLATE_FRAMES = 64
"""Most frames that the background is collected from."""
THREADS = 2
"""That solve: kernels let other threads run."""


class MattedFrame(NamedTuple):
    """A frame with its matte."""

    frame: TimedFrame
    alpha: Float32[np.ndarray, "h w"]
    """In [0, 1]."""
    foreground: Float32[np.ndarray, "h w 3"]
    """Colours of the person in sRGB, in [0, 1]."""


def at_size(coarse: Float[np.ndarray, "h w"], shape: tuple[int, ...]) -> Float32[np.ndarray, "h2 w2"]:
    """Scale a coarse matte to an image.

    Args:
        coarse: In [0, 1], of any resolution.
        shape: Of the image.

    Returns:
        In [0, 1].
    """
    scaled = cv2.resize(coarse.astype(np.float32), shape[1::-1], interpolation=cv2.INTER_CUBIC)
    return np.nan_to_num(scaled).clip(0, 1)


def certain_background(coarse: Float[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """What lies far enough outside a coarse outline to hold no hair.

    Args:
        coarse: Coarse matte in [0, 1], at the size of the image.

    Returns:
        The region.
    """
    return ~grown(coarse > BACKGROUND, round(PLATE_MARGIN * in_pixels(OUTWARD, coarse.shape)))


def refined_alpha(
    image: UInt8[np.ndarray, "h w 3"], coarse: Float[np.ndarray, "h w"], background: Background | None
) -> Float32[np.ndarray, "h w"]:
    """Refine a coarse matte.

    Args:
        image: sRGB.
        coarse: Coarse matte in [0, 1], at the size of the image.
        background: What is behind the person, if anything is known.

    Returns:
        Alpha in [0, 1].
    """
    regions = trimap(coarse, None if background is None else distance_from(image, background))
    estimate, certainty = difference_prior(image, regions, background)
    weight = PRIOR_WEIGHT * certainty + COARSE_WEIGHT
    prior = (PRIOR_WEIGHT * certainty * estimate + COARSE_WEIGHT * with_colours(coarse, image, regions)) / weight
    return closed_form_alpha(image, regions, prior, weight)


def matted_frames(
    footage: Iterable[TimedFrame], coarse_matte: Callable[[TimedFrame], Float[np.ndarray, "h w"]] | None = None
) -> Iterator[MattedFrame]:
    """Make the mattes of a clip of one camera.

    The first pass collects the background, the second one solves; so the footage is iterated over twice. A few frames
    are in memory at a time.

    Args:
        footage: The frames, in order.
        coarse_matte: Gives the coarse matte of a frame in [0, 1], of any resolution, as a network finds it. None to
            find the person before a plain background.

    Yields:
        The frames with their mattes, in order.

    Raises:
        CarigsError: If there is no coarse matte, and the background is not plain.
    """
    coarse_of = coarse_matte or _before_plain_background
    plate = _plate(footage, coarse_of) if coarse_matte else None
    motion_to = ImageMotion()
    steady_coarse, steady_alpha = SteadyMatte(COARSE_SHARE), SteadyMatte(ALPHA_SHARE, keep_certain=True)

    def with_coarse(frame: TimedFrame) -> tuple[TimedFrame, Motion | None, Float32[np.ndarray, "h w"]]:
        motion = motion_to(frame.image)
        return frame, motion, steady_coarse(at_size(coarse_of(frame), frame.image.shape), motion)

    def solved(
        guess: tuple[TimedFrame, Motion | None, Float32[np.ndarray, "h w"]],
    ) -> tuple[TimedFrame, Motion | None, Float32[np.ndarray, "h w"]]:
        frame, motion, coarse = guess
        return frame, motion, refined_alpha(frame.image, coarse, plain_background(frame.image) or plate)

    for frame, motion, alpha in in_order(solved, map(with_coarse, footage), THREADS):
        alpha = steady_alpha(alpha, motion)
        yield MattedFrame(frame, alpha, foreground_colours(frame.image, alpha))


def given_mattes(
    footage: Iterable[TimedFrame], matte: Callable[[TimedFrame], Float[np.ndarray, "h w"]]
) -> Iterator[MattedFrame]:
    """Use mattes that another program has made as they are, and find the colours of the person.

    Args:
        footage: The frames.
        matte: Gives alpha in [0, 1] of a frame.

    Yields:
        The frames with their mattes, in order.
    """
    for frame in footage:
        alpha = at_size(matte(frame), frame.image.shape)
        yield MattedFrame(frame, alpha, foreground_colours(frame.image, alpha))


def _plate(
    footage: Iterable[TimedFrame], coarse_of: Callable[[TimedFrame], Float[np.ndarray, "h w"]]
) -> Background | None:
    """The background that a clip shows, from evenly spread frames."""
    every = max(len(footage) // PLATE_FRAMES, 1) if isinstance(footage, Sized) else 1
    chosen = (frame for number, frame in enumerate(footage) if number % every == 0)
    return clean_plate((f.image, certain_background(at_size(coarse_of(f), f.image.shape))) for f in chosen)


def _before_plain_background(frame: TimedFrame) -> Float32[np.ndarray, "h w"]:
    """Coarse matte of the largest thing that differs from a plain background."""
    background = plain_background(frame.image)
    if background is None:
        raise CarigsError(f"frame {frame.number}: the background is not plain, and there is no coarse matte")
    return largest_region(distance_from(frame.image, background) > DIFFERENT).astype(np.float32)


def largest_region(region: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Keep the largest connected part of a region, and fill its holes.

    Args:
        region: The region.

    Returns:
        The part, with every hole that does not touch the image's border.
    """
    _, labels, sizes, _ = cv2.connectedComponentsWithStats(region.astype(np.uint8), connectivity=4)
    if len(sizes) < 2:
        return np.zeros_like(region)
    part = labels == 1 + np.argmax(sizes[1:, cv2.CC_STAT_AREA])
    _, outside = cv2.connectedComponents((~part).astype(np.uint8), connectivity=4)
    at_border = np.unique(np.concatenate([outside[0], outside[-1], outside[:, 0], outside[:, -1]]))
    return ~(np.isin(outside, at_border[at_border > 0]))
