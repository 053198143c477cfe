"""What is known of the frames of one camera, by which their quality is judged; and measures for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from carigs.detection.mesh_indices import LEFT_EYE, LEFT_LID_GAPS, LIP_GAPS, RIGHT_EYE, RIGHT_LID_GAPS

FACE_WIDTH = 128
"""Pixels to which faces are reduced before their sharpness is measured: noise of the camera averages out."""
OUTER, INNER = 0, 8
"""Positions of the corners in `LEFT_EYE` and `RIGHT_EYE`."""


@dataclass(frozen=True)
class TrackedFrames:
    """Frames of one camera in the order of time; values of frames that were left out are NaN."""

    numbers: Int[np.ndarray, " n"]
    """In the footage."""
    times: Float[np.ndarray, " n"]
    """Seconds."""
    left_out: tuple[str, ...]
    """Why each frame was left out, for example `no face`; empty if it was tracked."""
    yaw: Float[np.ndarray, " n"]
    """Turn of the head against the camera in degrees, positive to the person's left (`head_angles`)."""
    pitch: Float[np.ndarray, " n"]
    """The same, positive down."""
    errors: Mapping[str, Float[np.ndarray, " n"]]
    """Mean distance of landmarks from the fitted head in pixels, of each region."""
    face_width: Float[np.ndarray, " n"]
    """Of the landmarks, in pixels."""
    outside: Float[np.ndarray, " n"]
    """Share of the head's vertices, without neck and body, that lie outside the image."""
    mouth: Float[np.ndarray, " n"]
    """Opening of the mouth (`openings`)."""
    eyes: Float[np.ndarray, " n"]
    """Opening of the wider eye (`openings`)."""
    sharpness: Float[np.ndarray, " n"]
    """Of the face (`face_sharpness`)."""
    exposure: Float[np.ndarray, " n"]
    """Brightness against the median frame in stops (`carigs.footage.measures`)."""

    @property
    def tracked(self) -> Bool[np.ndarray, " n"]:
        """Frames that were not left out."""
        return np.array([not reason for reason in self.left_out], bool)

    @property
    def error(self) -> Float[np.ndarray, " n"]:
        """Mean error of the regions, in pixels."""
        known = np.array(list(self.errors.values()))
        counts = np.isfinite(known).sum(axis=0)
        return np.where(counts > 0, np.nansum(known, axis=0) / np.maximum(counts, 1), np.nan)


def head_angles(
    camera_from_head: Float[np.ndarray, "n 3 3"], middle: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """How far a head is turned away from a camera.

    Args:
        camera_from_head: Rotations from the head's axes (x to its left, y up, z forward) to OpenCV camera axes.
        middle: Where the head is, in the same axes, in any unit. A head at the side of the image that looks along the
            optical axis does not look at the camera.

    Returns:
        Yaw, positive to the person's left, and pitch, positive down, of the direction of the face against that to the
        camera, in degrees.
    """
    face, towards = (
        (np.arctan2(x, -z), np.arcsin((y / np.sqrt(x**2 + y**2 + z**2)).clip(-1, 1)))
        for x, y, z in (camera_from_head[:, :, 2].T, -middle.T)
    )
    yaw, pitch = (np.degrees(a - b) for a, b in zip(face, towards, strict=True))
    return (yaw + 180) % 360 - 180, pitch


def openings(landmarks: Float[np.ndarray, "n p 3"]) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """How far mouth and eyes are open, whatever the size of the face.

    Args:
        landmarks: MediaPipe's landmarks: x, y, z in pixels.

    Returns:
        Gap between the lips in distances of the outer corners of the eyes, and gap between the lids in widths of the
        eye, of the eye that is wider open.
    """
    face = _distance(landmarks, (LEFT_EYE[OUTER], RIGHT_EYE[OUTER]))
    mouth = np.mean([_distance(landmarks, pair) for pair in LIP_GAPS], axis=0) / face
    eyes = [
        np.mean([_distance(landmarks, pair) for pair in gaps], axis=0) / _distance(landmarks, (eye[OUTER], eye[INNER]))
        for eye, gaps in ((LEFT_EYE, LEFT_LID_GAPS), (RIGHT_EYE, RIGHT_LID_GAPS))
    ]
    return mouth, np.maximum(*eyes)


def face_sharpness(image: UInt8[np.ndarray, "h w 3"], box: tuple[int, int, int, int]) -> float:
    """Sharpness of a face that is reduced to one size, so that cameras can be compared with each other.

    Args:
        image: sRGB.
        box: Left, top, right and bottom of the face in pixels.

    Returns:
        Variance of the Laplacian of the brightness in levels of 8 bits (Pech-Pacheco et al. 2000): 80 to 450 for sharp
        faces, below 45 after a blur of 1 % of the face's width. 0 for an empty box.
    """
    left, top, right, bottom = (max(int(edge), 0) for edge in box)
    part = image[top:bottom, left:right]
    if part.size == 0:
        return 0.0
    grey = cv2.cvtColor(part, cv2.COLOR_RGB2GRAY)
    height = max(round(FACE_WIDTH * grey.shape[0] / grey.shape[1]), 1)
    return float(cv2.Laplacian(cv2.resize(grey, (FACE_WIDTH, height), interpolation=cv2.INTER_AREA), cv2.CV_32F).var())


def _distance(landmarks: Float[np.ndarray, "n p 3"], pair: tuple[int, int]) -> Float[np.ndarray, " n"]:
    return np.linalg.norm(landmarks[:, pair[0]] - landmarks[:, pair[1]], axis=1)
