"""Does `cy` count from the top of the image, or from its bottom?

VHAP writes `h - cy` since November 2024, and does not say so. The outlines of the posed mesh tell: with the right
convention, more of the mesh's silhouette lies on the outline of the matte. Hair and clothes cover it in either case.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Bool, Float

from carigs.capture import Camera, Capture, Frame
from carigs.capture.evenly_spread import evenly_spread
from carigs.errors import InputError
from carigs.head import pose
from carigs.plausibility.views import head_faces
from carigs.raster import compute_visibility

CENTRED = 0.5
"""Pixels from the middle of the image up to which the convention does not matter."""
DOES_NOT_MATTER = "centred, so that the convention does not matter"
SMALL = 0.01
"""Share of the image's height up to which a mistake is no more than a warning, if the outlines cannot decide."""
FRAMES = 12
TOLERANCE = 0.005
"""Distance of two outlines that agree, in sizes of the silhouette (square root of its area): 1 mm."""
BETTER = 1.15
"""A convention is believed if so many times as much of the silhouette agrees."""
LEAST = 0.05
"""Least share of the silhouette that must agree."""


def resolve_cy(capture: Capture, convention: str = "auto") -> Capture:
    """Convert principal points to OpenCV's convention: y down, from the top of the image.

    Args:
        capture: The capture, as indexed by `read_dataset`.
        convention: What the files hold: `opencv`, `flipped`, or `auto` to find out.

    Returns:
        The capture with its field `cy`: the convention of the files and how it was found.

    Raises:
        InputError: If `auto` cannot tell, and a mistake would matter.
    """
    if convention != "auto":
        return with_cy(capture, convention, f"capture.cy={convention}")
    convention, reason, warnings = _find(capture)
    return replace(with_cy(capture, convention, reason), warnings=(*capture.warnings, *warnings))


def with_cy(capture: Capture, convention: str, reason: str) -> Capture:
    """Convert principal points from a known convention to OpenCV's.

    Args:
        capture: The capture, as its files say.
        convention: `opencv` or `flipped`.
        reason: How it was found.

    Returns:
        The capture with its field `cy`.
    """
    calibrations = capture.calibrations
    if convention == "flipped":
        calibrations = tuple(flipped_cy(camera) for camera in calibrations)
    return replace(capture, calibrations=calibrations, cy=f"{convention}: {reason}")


def flipped_cy(camera: Camera) -> Camera:
    """The camera whose `cy` counts from the other end of the image.

    Args:
        camera: The camera.

    Returns:
        The other camera.
    """
    return replace(camera, cy=camera.height - camera.cy)


def cy_offsets(capture: Capture) -> Float[np.ndarray, " c"]:
    """Distances of `cy` from the middle of the image.

    Args:
        capture: The capture.

    Returns:
        Pixels, of each calibration.
    """
    return np.array([abs(camera.cy - camera.height / 2) for camera in capture.calibrations])


def _find(capture: Capture) -> tuple[str, str, list[str]]:
    """Convention, reason and warnings."""
    offsets = cy_offsets(capture)
    if not offsets.max(initial=0) > CENTRED:
        return "opencv", DOES_NOT_MATTER, []
    frames = _informative_frames(capture, offsets)
    agreement = np.mean([_agreement(capture, frame) for frame in frames], axis=0)
    shares = f"{agreement[0]:.0%} of the mesh's outlines agree with the mattes, flipped {agreement[1]:.0%}"
    order = np.argsort(agreement)
    if agreement[order[1]] >= LEAST and agreement[order[1]] > BETTER * agreement[order[0]]:
        return ("opencv", "flipped")[order[1]], shares, []
    problem = f"the principal point is up to {offsets.max():.1f} pixels off the middle, and outlines do not tell"
    advice = f"whether cy counts from the top ({shares}); set capture.cy to opencv or flipped"
    share = max(o / camera.height for o, camera in zip(offsets, capture.calibrations, strict=True))
    if share > SMALL:
        raise InputError(f"{problem} {advice}", file=capture.root, field="cy", remedy="carigs check --sheet shows it")
    return "opencv", shares, [f"{capture.root}: cy: {problem} {advice}"]


def _informative_frames(capture: Capture, offsets: np.ndarray) -> list[Frame]:
    """Frames of cameras with principal points far from the middle, of several cameras and timesteps."""
    best: dict[int, list[Frame]] = {}
    for frame in capture.frames:
        if offsets[frame.calibration] > CENTRED:
            best.setdefault(frame.camera, []).append(frame)
    cameras = sorted(best, key=lambda c: -offsets[best[c][0].calibration])[:FRAMES]
    each = -(-FRAMES // len(cameras))
    return [frame for c in cameras for frame in evenly_spread(best[c], each)]


def _agreement(capture: Capture, frame: Frame) -> tuple[float, float]:
    """Share of the mesh's silhouette that lies on the matte's outline, as the files say and flipped."""
    vertices = pose(capture.model, capture.parameters(frame.timestep))
    outline, head = _outline(capture.foreground(frame) >= 0.5), head_faces(capture.model)
    distance = cv2.distanceTransform((~outline).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    shares = []
    for camera in (capture.camera(frame), flipped_cy(capture.camera(frame))):
        face = compute_visibility(vertices, capture.model.faces, camera).face
        silhouette = (face >= 0) & head[face]
        edge = _outline(silhouette) & _outline(face >= 0)  # not where the head ends at the neck
        near = distance <= max(1.0, TOLERANCE * np.sqrt(silhouette.sum()))
        shares.append(float((edge & near).sum() / max(edge.sum(), 1)))
    return shares[0], shares[1]


def _outline(mask: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Pixels of a mask that have a neighbour outside; the border of the image is no outline."""
    return mask & ~cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=1).astype(bool)
