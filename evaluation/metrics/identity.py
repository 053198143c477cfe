"""Identity: is the caricature still the same person? Faces compared by dlib's face recognition network (King 2017)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8
from rich.progress import track

from carigs.capture import Capture
from carigs.capture.frame import Frame
from carigs.capture.frame_index import RenderedImage
from carigs.capture.images import read_rgb
from carigs.errors import InputError, WeightsMissing
from carigs.exaggeration import Caricature
from carigs.head import neutral, pose
from carigs.settings import Metrics
from carigs.weights.registry import registered
from carigs.weights.search import find_weights, locate_weights
from evaluation.metrics.face_alignment import ALIGNED, RIGID, face_chip, turn_from_camera
from evaluation.tables.metric_records import MetricRecord, StudyPoint, metric_record

WEIGHTS = "dlib_face_recognition"
"""Entry of the registry of weights."""
LARGEST_TURN = 60.0
"""Degrees between the direction of the face and the direction to the camera, up to which faces are compared."""
IDENTITY_METRICS = ("identity_cos", "identity_distance")

FaceNetwork = Callable[[UInt8[np.ndarray, "150 150 3"]], Float[np.ndarray, " d"]]
"""The embedding of an aligned face."""


def identity_scores(
    faces: Float[np.ndarray, "n d"], person: Float[np.ndarray, "m d"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Compare faces with the mean face of a person.

    Args:
        faces: Embeddings of faces.
        person: Embeddings of the person's real faces.

    Returns:
        Cosine, and Euclidean distance, to the mean of `person`. dlib takes two faces at a distance below 0.6 for the
        same person's; to a mean the distance is shorter than to the faces it is made of.
    """
    mean = person.mean(axis=0)
    cosine = faces @ mean / (np.linalg.norm(faces, axis=1) * np.linalg.norm(mean))
    return cosine, np.linalg.norm(faces - mean, axis=1)


def find_dlib_weights(settings: Metrics) -> Path:
    """Find the weights: where all weights are searched, then in the package `face_recognition_models`.

    The package is located, not imported: its code needs a part of setuptools that is no longer there.

    Args:
        settings: Settings of the stage `metrics`.

    Returns:
        The file.

    Raises:
        WeightsMissing: There is no such file.
        InputError: It is another one than the registry states.
    """
    weights, package = registered(WEIGHTS), find_spec("face_recognition_models")
    if package is not None and locate_weights(weights, settings.weights) is None:
        return find_weights(weights, Path(package.submodule_search_locations[0]) / "models")
    return find_weights(weights, settings.weights)


def load_dlib(file: Path) -> FaceNetwork:
    """Load dlib's face recognition network.

    Args:
        file: Network weights.

    Returns:
        The embedding of an aligned face.

    Raises:
        WeightsMissing: dlib is not installed.
        InputError: The file is not that network.
    """
    try:
        import dlib
    except ImportError as error:
        raise WeightsMissing("dlib is not installed: pip install 'carigs[identity]'") from error
    try:
        network = dlib.face_recognition_model_v1(str(file))
    except RuntimeError as error:
        raise InputError(f"not dlib's face recognition network ({error})", file=file) from error
    return lambda chip: np.array(network.compute_face_descriptor(chip))


@dataclass
class FaceEmbedder:
    """Embeds the face in images of one subject, aligned by the landmarks of the posed mesh."""

    subject: Capture
    network: FaceNetwork
    caricature: Caricature | None = None
    """Change of the head that the images show; None for the natural head."""
    _landmarks: dict[int, Float[np.ndarray, "68 3"]] = field(default_factory=dict)

    def landmarks(self, timestep: int) -> Float[np.ndarray, "68 3"]:
        """Landmarks of the posed head.

        Args:
            timestep: A timestep of the capture.

        Returns:
            Positions in world coordinates in metres.
        """
        if timestep not in self._landmarks:
            model = self.subject.model
            vertices = pose(model, self.subject.parameters(timestep), self.caricature)
            self._landmarks[timestep] = model.landmarks68.interpolate(vertices)
        return self._landmarks[timestep]

    def turn(self, frame: Frame) -> float:
        """Angle between the direction of the face and the direction to the camera.

        Args:
            frame: A frame of the capture.

        Returns:
            Degrees.
        """
        model, rigid = self.subject.model, list(RIGID)
        rest = model.landmarks68.interpolate(neutral(model, self.subject.parameters(frame.timestep)))
        return turn_from_camera(self.landmarks(frame.timestep)[rigid], rest[rigid], self.subject.camera(frame))

    def __call__(self, image: Float[np.ndarray, "h w 3"], frame: Frame) -> Float[np.ndarray, " d"]:
        """Embed the face in an image.

        Args:
            image: Image with values in [0, 1].
            frame: The frame with its camera and head parameters.

        Returns:
            The network's embedding.
        """
        points, _ = self.subject.camera(frame).project(self.landmarks(frame.timestep)[list(ALIGNED)])
        return self.network(face_chip(image, points, self.subject.background))


def identity_records(
    point: StudyPoint,
    rendered: list[RenderedImage],
    subject: Capture,
    caricature: Caricature,
    settings: Metrics,
) -> Iterator[MetricRecord]:
    """Compare the face of every `test` frame with the person's mean face in the real test frames.

    Args:
        point: Avatar and level.
        rendered: Rendered frames.
        subject: The capture.
        caricature: Caricature at the rendered level.
        settings: Settings of the stage `metrics`.

    Yields:
        Cosine and distance of each frame; without a value where the face looks away.

    Raises:
        WeightsMissing: dlib or its weights are missing and `settings.strict` is set.
        InputError: The weights are another file than the registry states.
    """
    rendered = [frame for frame in rendered if frame.protocol == "test"]
    reason, network = "", None
    if subject.model.landmarks68 is None:
        reason = "the head model has no landmarks"
    elif not rendered:
        reason = "too few test frames were rendered"
    else:
        try:
            network = load_dlib(find_dlib_weights(settings))
        except WeightsMissing as error:
            if settings.strict:
                raise
            reason = str(error)
    if network is None:
        for metric in IDENTITY_METRICS:
            yield metric_record(point, "test", (None, None), "full", metric, None, reason)
    else:
        yield from _compare_faces(point, rendered, subject, caricature, network)


def person_faces(embedder: FaceEmbedder) -> Float[np.ndarray, "m d"]:
    """Embed the person's faces in the real test frames.

    Args:
        embedder: Embedder of the natural head.

    Returns:
        Embeddings of the frames in which the face looks at the camera within `LARGEST_TURN`.
    """
    frames = [frame for frame in embedder.subject.split("test") if embedder.turn(frame) <= LARGEST_TURN]
    frames = track(frames, description="faces of the person", disable=len(frames) < 10)
    return np.array([embedder(embedder.subject.image(frame), frame) for frame in frames])


def _compare_faces(
    point: StudyPoint,
    rendered: list[RenderedImage],
    subject: Capture,
    caricature: Caricature,
    network: FaceNetwork,
) -> Iterator[MetricRecord]:
    natural, exaggerated = FaceEmbedder(subject, network), FaceEmbedder(subject, network, caricature)
    person = person_faces(natural)
    for shown in track(rendered, description="rendered faces", disable=len(rendered) < 10):
        frame = subject.frame_at[shown.timestep, shown.camera]
        turn, values, reason = natural.turn(frame), (None, None), ""
        if turn > LARGEST_TURN:
            reason = (
                f"the face looks {turn:.0f} degrees past the camera; it is compared up to {LARGEST_TURN:.0f} degrees"
            )
        elif not len(person):
            reason = f"no real test frame shows the face within {LARGEST_TURN:.0f} degrees"
        else:
            face = exaggerated(read_rgb(shown.file), frame)
            values = [float(score[0]) for score in identity_scores(face[None], person)]
        for metric, value in zip(IDENTITY_METRICS, values, strict=True):
            yield metric_record(point, "test", (frame.camera, frame.timestep), "full", metric, value, reason)
