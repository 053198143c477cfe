"""Exposure and white balance of the cameras of a capture, and the factors that match training frames to one camera.

Cameras are compared by what they show at the same vertices at the same time, whatever the light and the skin are; a
camera is compared with itself at other times by what it shows at the same vertices, and the light on a head that turns
by the normals. No true colours are needed. Where nothing significant is found, nothing changes.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64

from carigs.capture import Capture, Frame
from carigs.capture.corrections.colour_gains import EXPONENT, Gains
from carigs.exposure.known_median import median_of_known
from carigs.exposure.observations import Observations, observe
from carigs.exposure.offsets import fit_offsets

STATIC_TOLERANCE = 0.005
"""Difference of stored values, relative, below which a camera counts as equal to the reference: about one level of 255.
Gloss that cameras see from different sides looks like as much."""
DRIFT_TOLERANCE = 0.01
"""The same for a camera against itself at other times: shadows on a head that turns look like 0.7 %."""
LARGEST = np.log(16.0) / EXPONENT
"""Offset of four stops, beyond which the images show something else than the head."""
LEAST_TIMESTEPS = 4
"""Timesteps from which a drift is looked for."""
MANY_CAMERAS = 3
"""Number of cameras from which what most of them show at a moment is the light's: it is no drift of a camera."""
SLOW = 0.5
"""Von Neumann's ratio below which a series is slow (2 for independent values): between the timesteps that were looked
at, it may then be interpolated."""


class Exposures(NamedTuple):
    """Exposure and white balance of c cameras at t timesteps, as logarithms of (sRGB value + `TOE`)."""

    reference: int
    """Number of the camera that the others are compared with."""
    observations: Observations
    static: Float64[np.ndarray, "c 3"]
    """Offsets of cameras from the reference."""
    differs: Bool[np.ndarray, " c"]
    """Cameras that differ from the reference."""
    drift: Float64[np.ndarray, "c t 3"]
    """Offsets of cameras at timesteps from their median."""
    drifts: Bool[np.ndarray, " c"]
    """Cameras whose exposure changes slowly."""
    flickers: Bool[np.ndarray, " c"]
    """Cameras whose exposure changes too fast to be known between the timesteps that were looked at."""
    residual: Float64[np.ndarray, "c t v"]
    """What the drift and diffuse light leave of the brightness of the vertices of a camera; NaN where that is not known
    or an outlier."""

    def light(self, camera: int) -> Float64[np.ndarray, "3"]:
        """How bright a camera shows what the reference shows.

        Args:
            camera: Number of the camera.

        Returns:
            Ratio of linear light in red, green and blue.
        """
        return np.exp(EXPONENT * self.static[self.observations.cameras.index(camera)])

    def drift_range(self, camera: int) -> tuple[float, float]:
        """How much the light of a camera changes over time.

        Args:
            camera: Number of the camera.

        Returns:
            The darkest and the brightest timestep against the median, mean of the channels: ratio of linear light - 1.
        """
        light = np.exp(EXPONENT * self.drift[self.observations.cameras.index(camera)].mean(axis=-1)) - 1
        return float(light.min()), float(light.max())

    def gains(self, frame: Frame, sequences: dict[int, str]) -> Gains | None:
        """Factors on the light of a frame that match it to the reference.

        Args:
            frame: The frame.
            sequences: Sequence of each timestep: exposures are interpolated within sequences.

        Returns:
            Factors, or None if the frame is to stay as it is.
        """
        if frame.camera not in self.observations.cameras:
            return None
        c = self.observations.cameras.index(frame.camera)
        offset = np.where(self.differs[c], self.static[c], 0.0)
        if self.drifts[c]:
            times = self.observations.timesteps
            own = [k for k, t in enumerate(times) if sequences.get(t) == frame.sequence] or list(range(len(times)))
            at = [times[k] for k in own]
            offset = offset + [np.interp(frame.timestep, at, self.drift[c, own, channel]) for channel in range(3)]
        if not offset.any():
            return None
        red, green, blue = np.round(np.exp(-EXPONENT * offset), 4).tolist()
        return red, green, blue


def measure_exposures(capture: Capture) -> Exposures:
    """Compare the colours of cameras and timesteps. Test frames are not looked at.

    Args:
        capture: The capture; its frames have no gains.

    Returns:
        The exposures. The reference is the validation camera, else the most frontal camera.
    """
    frames = [frame for frame in capture.frames if frame.split != "test"]
    seen = observe(capture, frames)
    reference, shape = capture.validation_camera, seen.colour.shape
    drift, drifts, flickers, residual = _drifts(seen)
    if len(seen.timesteps) == len({frame.timestep for frame in frames}):  # nothing is interpolated
        drifts, flickers = drifts | flickers, np.zeros_like(flickers)
    colour = seen.colour - np.where(drifts[:, None, None], drift, 0)[:, :, None]
    static, differs = np.zeros((shape[0], 3)), np.zeros(shape[0], bool)
    if shape[0] > 1 and reference in seen.cameras:
        found = fit_offsets(colour, seen.patch, seen.cameras.index(reference))
        certain = found.is_significant() & (np.abs(found.offset) > STATIC_TOLERANCE)
        static, differs = found.offset, certain.any(axis=1) & (np.abs(found.offset) < LARGEST).all(axis=1)
    return Exposures(reference, seen, static, differs, drift, drifts, flickers, residual)


def match_exposures(capture: Capture, exposures: Exposures) -> Capture:
    """Give training frames the factors that match them to the reference camera.

    Frames that are held out stay as they are: metrics compare with the images as they are.

    Args:
        capture: The capture.
        exposures: Those of its cameras.

    Returns:
        The capture; the same if no camera differs.
    """
    if not (exposures.differs.any() or exposures.drifts.any()):
        return capture
    sequences = {frame.timestep: frame.sequence for frame in capture.frames}
    frames = tuple(
        replace(frame, gains=exposures.gains(frame, sequences)) if frame.split == "train" else frame
        for frame in capture.frames
    )
    return replace(capture, frames=frames)


def _drifts(seen: Observations) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Offsets of each camera at its timesteps, which cameras change slowly and which fast, and what is left."""
    cameras, times = seen.colour.shape[:2]
    drift, certain = np.zeros((cameras, times, 3)), np.zeros((cameras, times), bool)
    if times < LEAST_TIMESTEPS:
        return drift, np.zeros(cameras, bool), np.zeros(cameras, bool), np.full(seen.row.shape, np.nan)
    light = np.broadcast_to(diffuse_light(seen.normal)[:, None], (times, 1, seen.colour.shape[2], 8))
    found = [fit_offsets(colour[:, None], seen.patch, None, light) for colour in seen.colour]
    drift = np.array([each.offset for each in found])
    known = np.isfinite([each.error for each in found]).all(axis=-1)
    if cameras >= MANY_CAMERAS:
        drift -= np.nan_to_num(median_of_known(np.where(known[..., None], drift, np.nan)))
    for c, each in enumerate(found):
        each = each._replace(offset=drift[c])
        certain[c] = (each.is_significant() & (np.abs(drift[c]) > DRIFT_TOLERANCE)).any(axis=1)
        drift[c] = _filled(drift[c], known[c])
    changes = certain.any(axis=1) & (np.abs(drift) < LARGEST).all(axis=(1, 2))
    grey = drift.mean(axis=2)
    ratio = np.square(np.diff(grey, axis=1)).mean(axis=1) / np.maximum(grey.var(axis=1), 1e-12)
    residual = np.stack([each.residual[:, 0].mean(axis=-1) for each in found])
    return drift, changes & (ratio < SLOW), changes & (ratio >= SLOW), residual


def _filled(series: np.ndarray, known: np.ndarray) -> np.ndarray:
    """The series, interpolated where it is not known."""
    if not known.any():
        return np.zeros_like(series)
    index = np.arange(len(series))
    return np.stack([np.interp(index, index[known], channel[known]) for channel in series.T], axis=1)


def diffuse_light(normal: Float64[np.ndarray, "*n 3"]) -> Float64[np.ndarray, "*n 8"]:
    """Spherical harmonics of degrees 1 and 2, which explain 98 % of the light on a matte surface (Ramamoorthi 2001).

    Args:
        normal: Unit normals.

    Returns:
        Harmonics, without their constant factors.
    """
    x, y, z = np.moveaxis(normal, -1, 0)
    return np.stack([x, y, z, x * y, y * z, 3 * z * z - 1, x * z, x * x - y * y], axis=-1)
