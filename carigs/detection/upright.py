"""Whether the faces of footage are upright: a landmark network takes a face that is upside down for an upright one.

The detectors do not: both are surer of an upright face, the one for small faces hardly finds others, and their points
say where the eyes and the mouth are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import UInt8

from carigs.detection.face_detector import EYES, MOUTH, Face
from carigs.detection.face_networks import FaceNetworks
from carigs.detection.face_track import FaceTrack, collect
from carigs.detection.face_tracking import follow_face

LEAST_GAIN = 0.3
"""Gain of the mean sum of both detectors' scores from which a turn is clear. With it, frames of two real and two
synthetic people, tilted by up to 40 degrees, were never turned away from upright; after a turn, frames with a tilt of
less than 20 degrees were set upright."""
UPRIGHT = np.radians(30)
"""Largest angle of a face's axis against the vertical after a turn, in the median."""
FEWEST, ENOUGH, MOST = 5, 12, 60
"""Images with a face that are needed (a single one can mislead), that are enough, and images that are looked at."""


def quarter_turns(images: Iterable[UInt8[np.ndarray, "h w 3"]], networks: FaceNetworks) -> int:
    """Find how images must be turned so that faces are upright.

    Args:
        images: RGB values, with one wrong orientation or none; no more are taken than are needed.
        networks: The networks.

    Returns:
        Quarter turns clockwise; 0 unless another number is clearly right.
    """
    scores, angles = [], []
    for _, image in zip(range(MOST), images, strict=False):
        found = [_largest_scores(turned(image, turns), networks) for turns in range(4)]
        if any(score > 0 for score, _ in found):
            scores.append([score for score, _ in found])
            angles.append([angle for _, angle in found])
        if len(scores) == ENOUGH:
            break
    if len(scores) < FEWEST:
        return 0
    gain = np.mean(scores, axis=0) - np.mean(scores, axis=0)[0]
    gain[np.median(np.nan_to_num(angles, nan=np.pi), axis=0) > UPRIGHT] = -np.inf
    best = int(gain.argmax())
    return best if gain[best] >= LEAST_GAIN else 0


def follow_upright(
    images: Callable[[], Iterable[UInt8[np.ndarray, "h w 3"]]], networks: FaceNetworks
) -> tuple[FaceTrack, int]:
    """Find the landmarks of one person in images that may lie on the side, or upside down, and stay as they are.

    Args:
        images: Gives the RGB values, in the order of time; it is called twice.
        networks: The networks.

    Returns:
        Landmarks in the pixels of the images, and the quarter turns clockwise that would set the images upright.
    """
    turns, sizes = quarter_turns(images(), networks), list[tuple[int, ...]]()

    def upright() -> Iterator[UInt8[np.ndarray, "h w 3"]]:
        for image in images():
            sizes.append(image.shape[1::-1])
            yield turned(image, turns)

    track = collect(follow_face(upright(), networks))
    if not turns:
        return track, 0
    landmarks = track.landmarks.copy()
    for points, (width, height) in zip(landmarks, sizes, strict=True):
        x, y = points[:, 0].copy(), points[:, 1].copy()
        # Where a clockwise turn of the image has taken a pixel from.
        points[:, 0], points[:, 1] = {1: (y, height - x), 2: (width - x, height - y), 3: (width - y, x)}[turns]
    boxes = np.concatenate([landmarks[:, :, :2].min(axis=1), landmarks[:, :, :2].max(axis=1)], axis=1)
    return replace(track, landmarks=landmarks, boxes=boxes), turns


def turned(image: UInt8[np.ndarray, "h w 3"], turns: int) -> UInt8[np.ndarray, "h2 w2 3"]:
    """Turn an image.

    Args:
        image: The image.
        turns: Quarter turns clockwise.

    Returns:
        The turned image.
    """
    return np.ascontiguousarray(np.rot90(image, -turns))


def _largest_scores(image: UInt8[np.ndarray, "h w 3"], networks: FaceNetworks) -> tuple[float, float]:
    """Sum of the detectors' highest scores, and the angle of the surest face against the vertical; NaN without one."""
    surest = [max(detector(image), key=lambda face: face.score, default=None) for detector in networks[:2]]
    faces = [face for face in surest if face is not None]
    if not faces:
        return 0.0, np.nan
    return sum(face.score for face in faces), _angle(max(faces, key=lambda face: face.score))


def _angle(face: Face) -> float:
    """Between the line from the eyes to the mouth and the vertical, in radians from 0 to pi."""
    down = face.points[MOUTH] - face.points[list(EYES)].mean(axis=0)
    return abs(float(np.arctan2(down[0], down[1])))
