"""One person's head tracked by landmarks in uncalibrated cameras: what is shared first, then every frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from carigs.capture.evenly_spread import evenly_spread
from carigs.fitting.fitted_parameters import FittedParameters
from carigs.fitting.head_points import HeadPoints
from carigs.fitting.levenberg_marquardt import Bounds, minimise
from carigs.head import HeadModel, HeadParameters, SurfacePoints
from carigs.tracking.cameras import Cameras
from carigs.tracking.skin.between_views import SimultaneousViews
from carigs.tracking.solver.objective import Shared
from carigs.tracking.solver.personal_expressions import landmark_errors, learn_corrections
from carigs.tracking.solver.priors import Motion, tracking_prior
from carigs.tracking.solver.shared_estimate import FIRST_STEPS, STEPS, SharedProblem
from carigs.tracking.solver.tracks import OUTLIERS, Tracks, face_size, information, landmark_sigma
from carigs.tracking.start import first_guess
from carigs.tracking.surface_fields import SurfaceField
from carigs.tracking.texture.skull_motion import SkullMotion
from carigs.tracking.visibility import facing_camera, preferred_views
from carigs.tracking.world import at_the_head

LEAST_COUNT = 0.1
"""Share of a landmark's weight below which it is left out: what the network guesses says nothing about errors."""
SHARED_FRAMES = 60
"""Frames that what is shared is estimated from; half as many of several cameras."""
SIGMA = 0.01
"""First standard deviation of landmarks, in sizes of the face's box."""
ROUNDS = 3
"""Times that corrections of expressions are learned."""
TOLERANCE = 1e-4
"""Share of the cost of all frames by which a step must reduce it for the solver to go on."""


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
    """Distances in pixels between landmarks and the head's; NaN for missing landmarks. Of several cameras, errors that
    landmarks of a camera have in all frames alike are estimated, and not counted."""
    projected: Float[np.ndarray, "t c n 2"]
    """Where the network would see the head's landmarks, in pixels: with the constant offset and error of each."""

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
    views: SimultaneousViews | None = None,
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
        views: What several cameras recorded; None for one, or to go by landmarks alone.

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
    n, sigma = len(embedding), SIGMA * face_size(tracks)
    if skull is not None:
        points = HeadPoints(model, fitted, embedding.joined(skull.points)).merged()
        tracks = _with_anchors(tracks, skull)
    bounds = _bounds(model, fitted)
    chosen = np.array(evenly_spread([*found], SHARED_FRAMES if tracks.pixels.shape[1] == 1 else SHARED_FRAMES // 2))
    problem = SharedProblem(model, fitted, embedding, points, tracks.at(chosen), chosen, cameras, motion, focal, bounds)
    known = problem.estimate(frames[chosen], sigma, views)
    tracks = tracks.less(known.view_errors)
    cameras, sigma, count = cameras.moved(known.camera), known.sigma, len(known.offsets)

    # The person: offsets and corrections of expressions are smooth on the surface.
    eyeballs = model.vertex_region("left_eyeball", "right_eyeball")
    offsets = known.offsets.copy()
    if len(cameras.focal) == 1:  # which does not tell an eyeball that lies elsewhere from one that looks elsewhere
        irises = np.flatnonzero(eyeballs[embedding.corners].all(axis=1))
        offsets[irises] = embedding[irises].interpolate(known.static_offset)
    person = points.with_offsets(offsets).of_person(known.shape, model.joint_regressor @ known.static_offset)
    field = SurfaceField(problem.vertices(known.shape), model.faces, embedding)
    blendshapes = person.expressions()
    frames = _between(len(frames), chosen, known.frames)
    corrections = np.zeros_like(blendshapes)
    nothing = Shared(0, 0, 0)
    prior = tracking_prior(model, fitted, tracks.times, nothing, motion, np.zeros(0), focal)
    own = person
    rounds = ROUNDS if len(frames) > 1 else 0  # of one expression, the landmarks' offsets hold all that is its own
    on_mesh = np.zeros((len(model.v_template), blendshapes[0].size))
    for turn in range(rounds + 1):
        weights = information(sigma, n, count)
        objective = tracks.objective(own, cameras, nothing, weights, OUTLIERS[1], prior)
        steps = STEPS if turn == rounds else FIRST_STEPS
        frames, _ = minimise(objective, frames, np.zeros(0), steps=steps, tolerance=TOLERANCE, bounds=bounds)
        if turn < rounds:
            counts = weights * tracks.confidence
            errors = landmark_errors(own, cameras, frames, tracks.pixels, counts, OUTLIERS[1]).of(slice(n))
            coefficients = frames[:, fitted.expression_slice]
            learned = learn_corrections(errors, coefficients, blendshapes[:n], corrections[:n])
            on_mesh = field.fit(learned.reshape(n, -1))
            on_mesh[eyeballs] = 0  # these turn, and keep their form
            corrections[:n] = embedding.interpolate(on_mesh).reshape(learned.shape)
            own = person.with_expressions(corrections)
            sigma = landmark_sigma(np.linalg.norm(errors.error, axis=-1), errors.information > 0)
    errors = objective.errors(frames, np.zeros(0))[:, :, :n]
    frames, cameras = at_the_head(own, frames, cameras)
    own_model = _with_expressions(model, fitted, on_mesh.reshape(len(on_mesh), 3, -1))
    each = (fitted.head_parameters(model, frame, known.shape) for frame in frames)
    parameters = [replace(one, static_offset=known.static_offset) for one in each]
    projected = cameras.project(own.positions(frames, np.zeros(0)))[0][:, :, :n] + known.view_errors[:, :n]
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


def _with_anchors(tracks: Tracks, skull: SkullMotion) -> Tracks:
    """Tracks of the landmarks and of the anchors of the skull, which the first camera sees."""
    t, c = tracks.confidence.shape[:2]
    pixels, known = np.zeros((t, c, len(skull.points), 2)), np.zeros((t, c, len(skull.points)))
    pixels[:, 0], known[:, 0] = skull.pixels, skull.known[:, None]
    joined = (np.concatenate(pair, axis=2) for pair in ((tracks.pixels, pixels), (tracks.confidence, known)))
    return Tracks(*joined, tracks.times)


def _between(count: int, chosen: Int[np.ndarray, " m"], some: Float[np.ndarray, "m q"]) -> Float[np.ndarray, "t q"]:
    """Start of all frames from those of some of them: linear in the number of the frame."""
    return np.stack([np.interp(np.arange(count), chosen, column) for column in some.T], axis=1)


def _with_expressions(model: HeadModel, fitted: FittedParameters, corrections: Float[np.ndarray, "v 3 e"]) -> HeadModel:
    shapedirs = model.shapedirs.copy()
    shapedirs[:, :, model.num_identity + fitted.expression] += corrections.astype(np.float32)
    return replace(model, shapedirs=shapedirs)
