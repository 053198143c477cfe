"""Synthetic footage as `carigs track` has it once networks have looked at it: frames, with landmarks by the truth."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, UInt8

from carigs.capture import Capture
from carigs.detection import FaceTrack
from carigs.detection.likeness import COLOURS
from carigs.detection.mesh_indices import COUNT
from carigs.embedding import landmark_embedding
from carigs.footage import Footage
from carigs.footage.measures import measure_frames
from carigs.settings import Toy, Track
from carigs.toy import ToySubject, make_subject
from carigs.tracking.recording import Recording
from evaluation.benchmarks.footage.backgrounds import background
from evaluation.benchmarks.footage.dataset_views import dataset_footage, dataset_person
from evaluation.benchmarks.footage.motion import Talk
from evaluation.benchmarks.footage.oracle_landmarks import LandmarkNoise, oracle_landmarks
from evaluation.benchmarks.footage.rendering import before, person
from evaluation.benchmarks.footage.scenes import KINDS
from evaluation.benchmarks.footage.truth import FootageTruth

SEED = 2
"""Of the person, the motion and the noise."""


class Filmed(NamedTuple):
    """Footage of c cameras, with its truth."""

    truth: FootageTruth
    frames: list[list[UInt8[np.ndarray, "h w 3"]]]
    """Of each camera."""
    mattes: list[list[UInt8[np.ndarray, "h w"]]]


def toy_subject(**changes: object) -> ToySubject:
    """The procedural person that is filmed.

    Args:
        **changes: Settings that differ.

    Returns:
        The person.
    """
    return make_subject(Toy(**({"seed": SEED, "supersampling": 2, "hair": "short"} | changes)))


def filmed_toy(subject: ToySubject, kind: str, talk: Talk, side: int = 512, behind: str = "plain") -> Filmed:
    """Film the procedural person.

    Args:
        subject: The person.
        kind: One of `evaluation.benchmarks.footage.scenes.KINDS`.
        talk: What the person does.
        side: Width and height of the frames in pixels.
        behind: One of `evaluation.benchmarks.footage.backgrounds.KINDS`.

    Returns:
        The footage.
    """
    truth = KINDS[kind](subject.model, subject.shape, side, talk)
    return _filmed(truth, [person(subject, truth, camera) for camera in range(len(truth.cameras[0]))], behind)


def filmed_dataset(capture: Capture, kind: str, behind: str = "plain") -> Filmed:
    """Take the frames of a dataset with exact parameters for footage.

    Args:
        capture: The dataset.
        kind: As of `evaluation.benchmarks.footage.dataset_views.dataset_footage`.
        behind: One of `evaluation.benchmarks.footage.backgrounds.KINDS`.

    Returns:
        The footage.
    """
    truth, chosen = dataset_footage(capture, kind)
    return _filmed(truth, [dataset_person(capture, chosen, camera) for camera in range(len(chosen[0]))], behind)


def _filmed(truth: FootageTruth, people: Sequence[Iterator], behind: str) -> Filmed:
    frames, mattes = [], []
    for number, pictures in enumerate(people):
        camera, rng = truth.cameras[0][number], np.random.default_rng([SEED, number])
        walls = background(behind, camera.height, camera.width, len(truth.parameters), rng)
        seen, opaque = zip(*before(pictures, walls, seed=number), strict=True)
        frames.append([*seen])
        mattes.append([*opaque])
    return Filmed(truth, frames, mattes)


def oracle_recordings(filmed: Filmed, noise: LandmarkNoise | None = None) -> list[Recording]:
    """The footage with landmarks by the truth, where the package has them on the head model.

    Args:
        filmed: The footage.
        noise: Errors of the landmarks; None for those of a network.

    Returns:
        A recording of each camera.
    """
    truth = filmed.truth
    embedding = landmark_embedding(truth.model)
    # A network also places what the head hides, and does not say so.
    noise = noise or LandmarkNoise(hide=False)
    values = oracle_landmarks(truth, embedding.points(truth.model), noise, seed=SEED).values
    footage = [_footage(number, images) for number, images in enumerate(filmed.frames)]
    faces = [_faces(values[:, number], embedding.landmarks) for number in range(len(footage))]
    return [Recording(clip, face, measure_frames(clip)) for clip, face in zip(footage, faces, strict=True)]


def _footage(number: int, images: list[UInt8[np.ndarray, "h w 3"]]) -> Footage:
    """A folder of frames, as `carigs track` reads it."""
    (height, width), count, rate = images[0].shape[:2], len(images), Track().frame_rate
    return Footage(
        Path(f"{number}"),
        width,
        height,
        tuple(range(count)),
        np.arange(count) / rate,
        fps=rate,
        duration=(count - 1) / rate,
        focal_length=None,
        decode=lambda: iter(images),
    )


def _faces(values: Float[np.ndarray, "t p 3"], landmarks: np.ndarray) -> FaceTrack:
    """The same face in all frames; landmarks without a place on the head are missing."""
    count = len(values)
    found = np.full((count, COUNT, 3), np.nan, np.float32)
    found[:, landmarks, :2], found[:, landmarks, 2] = values[..., :2], 0
    boxes = np.concatenate([values[..., :2].min(axis=1), values[..., :2].max(axis=1)], axis=1)
    ones = np.ones((count, COLOURS), np.float32)
    return FaceTrack(found, ones[:, 0], boxes.astype(np.float32), np.ones(count, np.int64), np.zeros(count, bool), ones)
