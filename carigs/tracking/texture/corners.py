"""Corners of the texture of hair and skin that are followed from frame to frame, where the head is rigid."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, UInt8

CORNERS = 600
"""Corners that are followed at a time."""
SPACING = 0.02
"""Between corners, in sizes of the head's image."""
MARGIN = 0.03
"""From skin that expressions move, in the same: a first guess of the head is not exact."""
CONTRAST, TILES = 3.0, (8, 8)
"""Limit and tiles of the equalised contrast: otherwise all corners would lie at the eyes, and none in dark hair."""
QUALITY = 0.005
"""Of the weakest corner, against the best one."""
WINDOW = 0.06
"""Side of the window that is compared, in sizes of the head's image."""
BACK = 0.5
"""Pixels by which a corner that is followed back may miss where it came from."""
LEAST_LENGTH, MOST_LENGTH = 8, 48
"""Frames that a corner is followed through."""
CELL, WANTED = 0.025, 4
"""Metres on the head, and corners in each cell of this size that are kept in a frame."""


@dataclass(frozen=True)
class HeadImage:
    """Where a first guess of the head has its vertices in the frames of one camera."""

    pixels: Float[np.ndarray, "t v 2"]
    shown: Bool[np.ndarray, "t v"]
    """Whether the camera sees them."""
    rigid: Bool[np.ndarray, " v"]
    """Which of them no expression moves."""
    rest: Float[np.ndarray, "v 3"]
    """On the template in metres."""

    @cached_property
    def size(self) -> float:
        """Median height or width of the head in pixels."""
        pairs = zip(self.pixels, self.shown, strict=True)
        return float(np.median([np.ptp(pixels[seen], axis=0).max() for pixels, seen in pairs if seen.any()]))


@dataclass(frozen=True)
class TextureTracks:
    """Corners in the frames that show them; one row for each frame of each corner."""

    corner: Int[np.ndarray, " k"]
    """Number of the corner, in ascending order."""
    frame: Int[np.ndarray, " k"]
    pixels: Float[np.ndarray, "k 2"]
    vertex: Int[np.ndarray, " n"]
    """The vertex of the first guess that each corner was nearest to."""


@dataclass
class _Track:
    vertex: int
    """The nearest one where the corner was found."""
    first: int
    pixels: list[Float32[np.ndarray, "2"]] = field(default_factory=list)


def follow_texture(images: Iterable[UInt8[np.ndarray, "h w 3"]], head: HeadImage) -> TextureTracks:
    """Follow corners by the method of Lucas and Kanade (Bouguet 2001), forwards and back.

    Args:
        images: The frames.
        head: Where the head is in them.

    Returns:
        Corners that are spread over the rigid part of the head.
    """
    spacing = SPACING * head.size
    window = 2 * int(WINDOW * head.size / 2) + 1
    equalise = cv2.createCLAHE(CONTRAST, TILES)
    ended, alive, before = list[_Track](), list[_Track](), None
    for t, image in enumerate(images):
        grey = equalise.apply(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY))
        region = _rigid_region(head, t, grey.shape)
        if alive:
            on = _follow(before, grey, alive, head.pixels[t] - head.pixels[t - 1], region, window)
            ended += [track for track, goes_on in zip(alive, on, strict=True) if not goes_on]
            alive = [track for track, goes_on in zip(alive, on, strict=True) if goes_on]
        alive += _new_tracks(grey, region, alive, head, t, spacing)
        before = grey
    return _spread([track for track in ended + alive if len(track.pixels) >= LEAST_LENGTH], head)


def _rigid_region(head: HeadImage, t: int, shape: tuple[int, ...]) -> UInt8[np.ndarray, "h w"]:
    """Pixels of skin and hair that no expression moves."""
    region = np.zeros(shape, np.uint8)
    for chosen, radius, value in ((head.rigid, SPACING / 2, 255), (~head.rigid, MARGIN, 0)):
        for x, y in head.pixels[t][head.shown[t] & chosen]:
            cv2.circle(region, (int(x), int(y)), max(round(radius * head.size), 1), value, -1)
    return region


def _new_tracks(
    grey: UInt8[np.ndarray, "h w"],
    region: UInt8[np.ndarray, "h w"],
    alive: list[_Track],
    head: HeadImage,
    t: int,
    spacing: float,
) -> list[_Track]:
    """Corners (Shi and Tomasi 1994) between those that are followed."""
    seen = np.flatnonzero(head.shown[t] & head.rigid)
    if len(alive) >= CORNERS or not len(seen):
        return []
    free = region.copy()
    for track in alive:
        cv2.circle(free, tuple(int(value) for value in track.pixels[-1]), round(spacing), 0, -1)
    corners = cv2.goodFeaturesToTrack(grey, CORNERS - len(alive), QUALITY, spacing, mask=free)
    corners = np.zeros((0, 2), np.float32) if corners is None else corners.reshape(-1, 2) + np.float32(0.5)
    nearest = [np.linalg.norm(head.pixels[t][seen] - corner, axis=1).argmin() for corner in corners]
    return [_Track(int(seen[n]), t, [corner]) for n, corner in zip(nearest, corners, strict=True)]


def _follow(
    before: UInt8[np.ndarray, "h w"],
    grey: UInt8[np.ndarray, "h w"],
    alive: list[_Track],
    moved: Float[np.ndarray, "v 2"],
    region: UInt8[np.ndarray, "h w"],
    window: int,
) -> list[bool]:
    """Add a frame to tracks; whether each goes on."""
    options = {"winSize": (window, window), "maxLevel": 2, "flags": cv2.OPTFLOW_USE_INITIAL_FLOW}
    start = np.array([track.pixels[-1] for track in alive], np.float32) - np.float32(0.5)
    guess = start + moved[[track.vertex for track in alive]].astype(np.float32)
    there, found, _ = cv2.calcOpticalFlowPyrLK(before, grey, start, guess.copy(), **options)
    back, returned, _ = cv2.calcOpticalFlowPyrLK(grey, before, there, start + there - guess, **options)
    column, row = np.clip(there.round().astype(int), 0, np.array(grey.shape[::-1]) - 1).T
    good = (found[:, 0] > 0) & (returned[:, 0] > 0) & (region[row, column] > 0)
    good &= (np.linalg.norm(back - start, axis=1) < BACK) & ([len(track.pixels) < MOST_LENGTH for track in alive])
    for track, pixel, goes_on in zip(alive, there, good, strict=True):
        if goes_on:
            track.pixels.append(pixel + np.float32(0.5))
    return good.tolist()


def _spread(tracks: list[_Track], head: HeadImage) -> TextureTracks:
    """The longest tracks, without those of frames and cells of the head that have enough of them."""
    _, cells = np.unique(np.floor(head.rest / CELL).astype(int), axis=0, return_inverse=True)
    counts, chosen = np.zeros((cells.max() + 1, len(head.pixels)), int), []
    for track in sorted(tracks, key=lambda track: (-len(track.pixels), track.first)):
        count = counts[cells[track.vertex], track.first : track.first + len(track.pixels)]
        if np.median(count) < WANTED:
            count += 1
            chosen.append(track)
    lengths = [len(track.pixels) for track in chosen]
    frames = [np.arange(track.first, track.first + len(track.pixels)) for track in chosen]
    pixels = [np.array(track.pixels, np.float64) for track in chosen]
    return TextureTracks(
        np.repeat(np.arange(len(chosen)), lengths),
        np.concatenate([np.zeros(0, int), *frames]),
        np.concatenate([np.zeros((0, 2)), *pixels]),
        np.array([track.vertex for track in chosen], int),
    )
