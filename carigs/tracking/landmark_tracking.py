"""One person's head tracked by landmarks in uncalibrated cameras: what is shared first, then every frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from carigs.capture.evenly_spread import evenly_spread
from carigs.fitting.fitted_parameters import FittedParameters
from carigs.fitting.head_points import HeadPoints
from carigs.fitting.levenberg_marquardt import Bounds, minimise
from carigs.fitting.objective import Prior
from carigs.head import HeadModel, HeadParameters, SurfacePoints
from carigs.tracking.cameras import Cameras
from carigs.tracking.objective import LandmarkObjective, Shared
from carigs.tracking.personal_expressions import landmark_errors, learn_corrections
from carigs.tracking.priors import Motion, tracking_prior
from carigs.tracking.start import first_guess
from carigs.tracking.surface_fields import SurfaceField
from carigs.tracking.texture.skull_motion import SkullMotion
from carigs.tracking.visibility import facing_camera, preferred_views
from carigs.tracking.world import at_the_head

INDEPENDENT = 0.25
"""Independent observations for each landmark of a dense face mesh: a network's errors are correlated along the face."""
OFFSET = 0.003
"""Standard deviation in metres of the offset of a landmark on this person's head from where the embedding has it."""
SHAPE_WIDTH, SHAPE_STIFFNESS = 0.012, 0.1
"""Of the field that takes the person's shape from these offsets, stiffer than that of expressions: a network marks
other points of the skin than the embedding has, by a millimetre and each landmark for itself. A field that followed
every offset made bumps of this, which caricatures enlarge."""
ANCHOR_OFFSET = 0.01
"""The same of an anchor of the skull, which is known in the images and not on the head."""
ANCHOR_SIGMA = 0.1
"""Standard deviation of an anchor in pixels."""
OUTLIERS = (30.0, 5.0)
"""Scales of the loss in standard deviations."""
LEAST_COUNT = 0.1
"""Share of a landmark's weight below which it is left out: what the network guesses says nothing about errors."""
SHARED_FRAMES = 60
"""Frames that what is shared is estimated from."""
SIGMA = 0.01
"""First standard deviation of landmarks, in sizes of the face's box."""
LEAST_SIGMA = 0.1
"""Pixels."""
MEDIAN_LENGTH = 1.1774
"""Median length of a vector of two normal variables with deviation 1."""
ROUNDS = 3
"""Times that corrections of expressions are learned."""
SHARED_TOLERANCE, TOLERANCE = 1e-3, 1e-4
"""Share of the cost by which a step must reduce it for the solver to go on: for what frames share, where a step takes
longest and the last ones move landmarks by hundredths of a pixel, and for the frames."""
STEPS, FIRST_STEPS = 25, 8
"""Most steps of the solver in the last passes, and in those whose result is the start of others."""


@dataclass(frozen=True)
class Tracks:
    """Landmarks of one person in one or more cameras that stand still; of a moment, one timestep in many cameras."""

    pixels: Float[np.ndarray, "t c n 2"]
    confidence: Float[np.ndarray, "t c n"]
    """From 0 (missing) to 1."""
    times: Float[np.ndarray, " t"]
    """Seconds."""

    def at(self, chosen: Int[np.ndarray, " m"]) -> Tracks:
        """The landmarks of some frames.

        Args:
            chosen: Indices of the frames.

        Returns:
            Their landmarks.
        """
        return Tracks(self.pixels[chosen], self.confidence[chosen], self.times[chosen])


@dataclass(frozen=True)
class TrackedHead:
    """The result of `track_landmarks`."""

    model: HeadModel
    """The head model with the person's own expressions."""
    parameters: list[HeadParameters]
    """Of each frame; the shape and the static offset are the person's."""
    cameras: Cameras
    sigma: float
    """Standard deviation of the landmarks in pixels."""
    errors: Float[np.ndarray, "t c n"]
    """Distances in pixels between landmarks and the head's; NaN for missing landmarks."""
    projected: Float[np.ndarray, "t c n 2"]
    """The head's landmarks in the images, in pixels, with the constant offset of each."""

    def displaced(self, offset: Float[np.ndarray, "v 3"]) -> TrackedHead:
        """The same with another shape, which the landmarks do not tell.

        Args:
            offset: What is added to the static offset, in metres.

        Returns:
            The head.
        """
        static = self.parameters[0].static_offset
        static = offset if static is None else static + offset
        return replace(self, parameters=[replace(frame, static_offset=static) for frame in self.parameters])


def track_landmarks(
    model: HeadModel,
    fitted: FittedParameters,
    embedding: SurfacePoints,
    tracks: Tracks,
    cameras: Cameras,
    *,
    focal_deviation: float | Float[np.ndarray, " l"],
    motion: Motion | None = None,
    skull: SkullMotion | None = None,
) -> TrackedHead:
    """Track a head: identity, cameras, and the parameters of every frame.

    Args:
        model: The head model.
        fitted: Its parameters that are estimated.
        embedding: The landmarks on the model.
        tracks: The landmarks in the images.
        cameras: First guess of the focal lengths; the pose of the first camera, which it keeps. Those of the others are
            found.
        focal_deviation: Standard deviation of the logarithm of the focal length, of all lenses or of each.
        motion: How much the head moves from frame to frame; None for a person who talks.
        skull: How the skull moves, if it is known, before the first camera.

    Returns:
        The head.

    Raises:
        CarigsError: If the landmarks place the head model in no frame, or not before a camera and another one at once.
    """
    motion = motion or Motion()
    focal = np.broadcast_to(np.asarray(focal_deviation, np.float64), cameras.lens_count)
    points = HeadPoints(model, fitted, embedding).merged()
    frames, cameras, found = first_guess(points, tracks.pixels, tracks.confidence > 0, cameras)
    counts = facing_camera(model, embedding, fitted, frames, cameras)
    counts *= preferred_views(points, _jaw(model, fitted), frames, cameras)
    tracks = replace(tracks, confidence=tracks.confidence * np.where(counts > LEAST_COUNT, counts, 0))
    n = len(embedding)
    if skull is not None:
        points = HeadPoints(model, fitted, embedding.joined(skull.points)).merged()
        tracks = _with_anchors(tracks, skull)
    bounds = _bounds(model, fitted)
    sigma = SIGMA * _face_size(tracks.pixels[:, :, :n], tracks.confidence[:, :, :n])
    offset = np.repeat([OFFSET, ANCHOR_OFFSET], [n, len(points.barycentric) - n])

    # What frames share, from some of them.
    chosen = np.array(evenly_spread([*found], SHARED_FRAMES))
    some, chosen_tracks = frames[chosen], tracks.at(chosen)
    vector = np.zeros(len(fitted.shape) + cameras.size)
    count = len(offset)
    passes = (0, OUTLIERS[0], FIRST_STEPS), (count, OUTLIERS[0], FIRST_STEPS), (count, OUTLIERS[1], STEPS)
    for moving, outlier, steps in passes:
        shared = Shared(len(fitted.shape), moving, cameras.size)
        if moving and len(vector) < shared.size:
            vector = np.insert(vector, len(fitted.shape), np.zeros(3 * moving))
        prior = tracking_prior(model, fitted, chosen_tracks.times, shared, motion, offset, focal)
        objective = _objective(points, cameras, shared, chosen_tracks, _information(sigma, n, count), outlier, prior)
        some, vector = minimise(objective, some, vector, steps=steps, tolerance=SHARED_TOLERANCE, bounds=bounds)
        sigma = _sigma(objective.errors(some, vector)[:, :, :n])
    shape, offsets, camera = shared.split(vector)
    cameras = cameras.moved(camera)

    # The person: offsets and corrections of expressions are smooth on the surface.
    vertices = model.v_template + model.identity_basis[:, :, fitted.shape] @ shape
    field = SurfaceField(vertices, model.faces, embedding)
    own_shape = SurfaceField(vertices, model.faces, embedding, width=SHAPE_WIDTH, stiffness=SHAPE_STIFFNESS)
    static_offset = own_shape.fit(offsets[:n])
    person = points.with_offsets(offsets).of_person(shape, model.joint_regressor @ static_offset)
    blendshapes = person.expressions()
    frames = _between(len(frames), chosen, some)
    corrections = np.zeros_like(blendshapes)
    nothing = Shared(0, 0, 0)
    prior = tracking_prior(model, fitted, tracks.times, nothing, motion, offset, focal)
    own = person
    rounds = ROUNDS if len(frames) > 1 else 0  # of one expression, the landmarks' offsets hold all that is its own
    on_mesh = np.zeros((len(vertices), blendshapes[0].size))
    for turn in range(rounds + 1):
        objective = _objective(own, cameras, nothing, tracks, _information(sigma, n, count), OUTLIERS[1], prior)
        steps = STEPS if turn == rounds else FIRST_STEPS
        frames, _ = minimise(objective, frames, np.zeros(0), steps=steps, tolerance=TOLERANCE, bounds=bounds)
        if turn < rounds:
            information = _information(sigma, n, count) * tracks.confidence
            errors = landmark_errors(own, cameras, frames, tracks.pixels, information, OUTLIERS[1]).of(slice(n))
            coefficients = frames[:, fitted.expression_slice]
            learned = learn_corrections(errors, coefficients, blendshapes[:n], corrections[:n])
            on_mesh = field.fit(learned.reshape(n, -1))
            corrections[:n] = embedding.interpolate(on_mesh).reshape(learned.shape)
            own = person.with_expressions(corrections)
            sigma = _sigma(np.linalg.norm(errors.error, axis=-1), errors.information > 0)
    errors = objective.errors(frames, np.zeros(0))[:, :, :n]
    frames, cameras = at_the_head(own, frames, cameras)
    own_model = _with_expressions(model, fitted, on_mesh.reshape(len(vertices), 3, -1))
    parameters = [replace(fitted.head_parameters(model, frame, shape), static_offset=static_offset) for frame in frames]
    projected = cameras.project(own.positions(frames, np.zeros(0)))[0][:, :, :n]
    return TrackedHead(own_model, parameters, cameras, sigma, errors, projected)


def _jaw(model: HeadModel, fitted: FittedParameters) -> slice | None:
    """The jaw's rotation among the parameters of a frame."""
    jaw = [i for i, joint in enumerate(fitted.joints) if model.joint_names[joint] == "jaw"]
    first = fitted.joint_slice.start + 3 * jaw[0] if jaw else 0
    return slice(first, first + 3) if jaw else None


def _bounds(model: HeadModel, fitted: FittedParameters) -> Bounds:
    """Named expressions are activations from 0 to 1; those of FLAME are principal components."""
    low, high = np.full(fitted.frame_size, -np.inf), np.full(fitted.frame_size, np.inf)
    if model.expression_names:
        low[fitted.expression_slice], high[fitted.expression_slice] = 0, 1
    return Bounds(low, high)


def _objective(
    points: HeadPoints,
    cameras: Cameras,
    shared: Shared,
    tracks: Tracks,
    weights: Float[np.ndarray, " n"],
    outlier: float,
    prior: Prior,
) -> LandmarkObjective:
    """Points with a weight each, in 1 / pixels^2."""
    information = (weights * tracks.confidence)[..., None, None] * np.eye(2)
    return LandmarkObjective(points, cameras, shared, tracks.pixels, information, outlier, prior)


def _information(sigma: float, landmarks: int, count: int) -> Float[np.ndarray, " n"]:
    """Weights of landmarks, of which a share counts, and of anchors."""
    return np.repeat([INDEPENDENT / sigma**2, ANCHOR_SIGMA**-2], [landmarks, count - landmarks])


def _with_anchors(tracks: Tracks, skull: SkullMotion) -> Tracks:
    """Tracks of the landmarks and of the anchors of the skull, which the first camera sees."""
    t, c = tracks.confidence.shape[:2]
    pixels, known = np.zeros((t, c, len(skull.points), 2)), np.zeros((t, c, len(skull.points)))
    pixels[:, 0], known[:, 0] = skull.pixels, skull.known[:, None]
    joined = (np.concatenate(pair, axis=2) for pair in ((tracks.pixels, pixels), (tracks.confidence, known)))
    return Tracks(*joined, tracks.times)


def _face_size(pixels: Float[np.ndarray, "t c n 2"], confidence: Float[np.ndarray, "t c n"]) -> float:
    """Median diagonal of the landmarks' box, in pixels."""
    known = pixels[(confidence > 0).any(axis=2)]
    seen = confidence[(confidence > 0).any(axis=2)] > 0
    low = np.where(seen[..., None], known, np.inf).min(axis=1)
    high = np.where(seen[..., None], known, -np.inf).max(axis=1)
    return float(np.median(np.linalg.norm(high - low, axis=1)))


def _sigma(errors: Float[np.ndarray, "t c n"], seen: Bool[np.ndarray, "t c n"] | bool = True) -> float:
    """Standard deviation of landmarks, by the median of their errors."""
    return max(float(np.nanmedian(np.where(seen, errors, np.nan))) / MEDIAN_LENGTH, LEAST_SIGMA)


def _between(count: int, chosen: Int[np.ndarray, " m"], some: Float[np.ndarray, "m q"]) -> Float[np.ndarray, "t q"]:
    """Start of all frames from those of some of them: linear in the number of the frame."""
    return np.stack([np.interp(np.arange(count), chosen, column) for column in some.T], axis=1)


def _with_expressions(model: HeadModel, fitted: FittedParameters, corrections: Float[np.ndarray, "v 3 e"]) -> HeadModel:
    shapedirs = model.shapedirs.copy()
    shapedirs[:, :, model.num_identity + fitted.expression] += corrections.astype(np.float32)
    return replace(model, shapedirs=shapedirs)
