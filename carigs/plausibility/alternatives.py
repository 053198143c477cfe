"""Frames against each other: does an image fit the head of another timestep, or another camera, better than its own?

An image is explained by the timestep and the camera that its file name states, or by another one. Each explanation
predicts where the vertices are in the image; the colours there are compared with those that the other frames show at
the same vertices. A sound image fits its own explanation best, however strong an expression or the noise is: a
threshold on the misfit alone could not tell them from swapped files.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, UInt8

from carigs.capture import Camera, Capture, Frame
from carigs.plausibility.exposures import LOCK, light_in_words
from carigs.plausibility.findings import Finding
from carigs.plausibility.vertex_misfit import (
    Reference,
    disagreement,
    misfit,
    reference,
    sample_inside,
    with_light_of,
)

BETTER = np.sqrt(0.5)
"""Another explanation is believed if it leaves less than this share of the misfit. Two explanations that are equally
good, such as neighbours in a video, differ by a few per cent; a wrong one doubles the misfit, or worse."""
OUTLIER = 4.0
"""An image fits badly if its misfit is this many times the median of its camera, ..."""
LEAST_OUTLIER = 12.0
"""... and at least so many levels of 255. Strong expressions reach 2.5 times the median."""
ACROSS_CAMERAS = 8
"""Number of timesteps at which cameras are compared with each other."""

HELD_OUT_LIGHT = f"hold out other frames: metrics compare with held-out frames as they are; {LOCK}"
ANOTHER_LIGHT = HELD_OUT_LIGHT, f"match the image to the others, or remove the frame; {LOCK}"
"""Remedies for another exposure of frames that are held out, and of frames for training."""

Pixels = Float32[np.ndarray, "n 2"]
Image = UInt8[np.ndarray, "h w 3"]


def _about(camera: Camera, factor: float) -> Callable[[Pixels], Pixels]:
    centre = np.array([camera.cx, camera.cy], np.float32)
    return lambda pixels: centre + np.float32(factor) * (pixels - centre)


def _shifted(camera: Camera, x: float, y: float) -> Callable[[Pixels], Pixels]:
    offset = np.array([x, y], np.float32) * max(camera.width, camera.height)
    return lambda pixels: pixels + offset


def _image_changes(camera: Camera) -> dict[str, Callable[[Pixels], Pixels]]:
    """Mistakes that move the contents of an image, as motions of positions in it."""
    size = np.array([camera.width, camera.height], np.float32)
    changes = {
        "the image mirrored": lambda p: np.stack([size[0] - p[:, 0], p[:, 1]], axis=1),
        "the image upside down": lambda p: np.stack([p[:, 0], size[1] - p[:, 1]], axis=1),
        "the image turned by 180 degrees": lambda p: size - p,
    }
    changes |= {f"focal lengths times {s:g}": _about(camera, s) for s in (0.5, 0.67, 0.8, 0.9, 1.1, 1.25, 1.5, 2.0)}
    for share in (0.04, 0.08):
        for key, x, y in (("cx", 1, 0), ("cx", -1, 0), ("cy", 0, 1), ("cy", 0, -1)):
            pixels = share * (x + y) * max(camera.width, camera.height)
            changes[f"{key} {pixels:+.0f} pixels"] = _shifted(camera, share * x, share * y)
    return changes


class Explained(NamedTuple):
    """Misfits of explanations, in levels of 255."""

    own: float
    best: float
    what: str
    """The best of the other explanations."""
    matched: float = np.inf
    """With exposure and white balance of the expected colours."""
    light: str = ""
    """How they differ."""

    @property
    def is_wrong(self) -> bool:
        """Whether another explanation is believed."""
        return self.best < BETTER * self.own

    @property
    def details(self) -> str:
        """For messages."""
        return f"{self.what} fits better: misfit {self.best:.1f} instead of {self.own:.1f} levels"


def compare_frames(
    capture: Capture,
    frames: Mapping[int, Mapping[int, Frame]],
    pixels: Mapping[Frame, Pixels],
    samples: Mapping[Frame, Float32[np.ndarray, "n 3"]],
) -> list[Finding]:
    """Find images and head parameters that belong to another timestep or camera, and wrong cameras.

    Args:
        capture: The capture.
        frames: Frames by timestep and camera.
        pixels: Positions of the compared vertices in each frame; NaN where they are hidden.
        samples: Colours there.

    Returns:
        What is likely to be wrong.
    """
    in_time = {}
    for c in {c for cameras in frames.values() for c in cameras}:
        track = [samples[cameras[c]] for cameras in frames.values() if c in cameras and cameras[c] in samples]
        if len(track) > 2:
            in_time[c] = reference(np.stack(track))
    some = set(list(frames)[:: max(1, -(-len(frames) // ACROSS_CAMERAS))])
    explained: dict[Frame, Explained] = {}
    across: dict[int, dict[str, list[float]]] = {}
    together: dict[str, list[float]] = {}
    for timestep, cameras in frames.items():
        seen = {c: frame for c, frame in cameras.items() if frame in samples}
        across_cameras = timestep in some and len(seen) > 2
        between = reference(np.stack([samples[f] for f in seen.values()])) if across_cameras else None
        changed: dict[str, list[Float32[np.ndarray, "n 3"]]] = {}
        for c, frame in seen.items():
            image = capture.image8(frame)
            if c in in_time:
                others = {t: pixels[f[c]] for t, f in frames.items() if t != timestep and c in f and f[c] in pixels}
                explained[frame] = _in_time(image, samples[frame], pixels[frame], others, in_time[c])
            if between is not None:
                under = {"": samples[frame]} | {
                    what: sample_inside(image, change(pixels[frame]))
                    for what, change in _image_changes(capture.camera(frame)).items()
                }
                for what, colours in under.items():
                    changed.setdefault(what, []).append(colours)
                under |= {f"camera {k}": sample_inside(image, pixels[f]) for k, f in seen.items() if k != c}
                for what, colours in under.items():
                    across.setdefault(c, {}).setdefault(what, []).append(misfit(colours, between))
        for what, colours in changed.items():
            together.setdefault(what, []).append(disagreement(np.stack(colours)))
    findings = _time_findings(capture, explained)
    for c, misfits in across.items():
        kind = "the camera does not agree with the other cameras on the colours of the head"
        remedy = "compare its transform_matrix and intrinsics with those of the other cameras"
        findings += _camera_findings(capture, misfits, f"camera {c}", kind, remedy)
    kind = "the cameras do not agree on the colours of the head"
    remedy = "compare the intrinsics of all cameras with the calibration"
    return findings + _camera_findings(capture, together, "transforms_*.json", kind, remedy)


def _in_time(
    image: Image,
    own: Float32[np.ndarray, "n 3"],
    pixels: Pixels,
    others: Mapping[int, Pixels],
    expected: Reference,
) -> Explained:
    """Explain an image by the timesteps of its camera, or by exchanged colour channels."""
    misfits = {f"the head of timestep {t}": misfit(sample_inside(image, p), expected) for t, p in others.items()}
    misfits["the image with red and blue exchanged"] = misfit(own[:, ::-1], expected)
    misfits["the image mirrored"] = misfit(sample_inside(image[:, ::-1], pixels), expected)
    misfits["the image upside down"] = misfit(sample_inside(image[::-1], pixels), expected)
    matched, light = with_light_of(own, expected)
    found = _best(misfit(own, expected), misfits)
    return found._replace(matched=misfit(matched, expected), light=light_in_words(light))


def _best(own: float, others: Mapping[str, float]) -> Explained:
    known = {what: value for what, value in others.items() if np.isfinite(value)}
    what = min(known, key=lambda w: known[w], default="")
    return Explained(own, known.get(what, np.inf), what)


def _time_findings(capture: Capture, explained: Mapping[Frame, Explained]) -> list[Finding]:
    timesteps: dict[int, list[Frame]] = {}
    for frame in explained:
        timesteps.setdefault(frame.timestep, []).append(frame)
    tracks: dict[int, list[float]] = {}
    for frame, misfits in explained.items():
        tracks.setdefault(frame.camera, []).append(misfits.own)
    usual = {c: float(np.nanmedian(values)) for c, values in tracks.items() if np.isfinite(values).any()}
    limits = {c: max(OUTLIER * value, LEAST_OUTLIER) for c, value in usual.items()}
    findings = []
    for members in timesteps.values():
        wrong = [frame for frame in members if explained[frame].is_wrong]
        rest = [frame for frame in members if frame not in wrong]
        bad = [frame for frame in rest if explained[frame].own > limits.get(frame.camera, np.inf)]
        if len(wrong) > 1 and len(wrong) > len(members) / 2:
            worst = max(wrong, key=lambda frame: explained[frame].own)
            kind = "most images of the timestep fit another timestep's head parameters better than these"
            file, remedy = capture.root / worst.parameters, "give the timestep the parameters of its images"
            details, size = f"{worst.name}: {explained[worst].details}", explained[worst].own
            findings.append(Finding(kind, file, "", details, remedy, size))
        else:
            kind = "the image does not fit its place, but another one"
            remedy = "give the file the name of the place that it fits"
            for frame in wrong:
                details = explained[frame].details
                findings.append(Finding(kind, capture.root / frame.image, "", details, remedy, explained[frame].own))
        for frame in bad:
            details = f"misfit {explained[frame].own:.1f} levels, usually {usual[frame.camera]:.1f}"
            kind = "the image does not fit the posed mesh as the camera's other images do"
            remedy = "track this timestep again, or remove the frame"
            if explained[frame].matched < BETTER * explained[frame].own:
                kind = "the image shows the head in another exposure or white balance than the camera's other images"
                details, remedy = explained[frame].light, ANOTHER_LIGHT[frame.split == "train"]
            findings.append(Finding(kind, capture.root / frame.image, "", details, remedy, explained[frame].own))
    return findings


def _camera_findings(
    capture: Capture, misfits: Mapping[str, list[float]], field: str, kind: str, remedy: str
) -> list[Finding]:
    """Misfits at several timesteps, of the stated cameras (the empty key) and of other explanations."""
    known = np.isfinite(misfits.get("", [])).sum()
    means = {
        what: float(np.nanmean(values))
        for what, values in misfits.items()
        if known and np.isfinite(values).sum() > known / 2
    }
    explained = _best(means.pop("", np.nan), means)
    if not explained.is_wrong:
        return []
    return [Finding(kind, capture.root, field, explained.details, remedy, explained.own)]
