"""What all frames of a tracked head share, estimated from some of them: identity, landmark offsets, and cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from carigs.fitting.fitted_parameters import FittedParameters
from carigs.fitting.head_points import HeadPoints
from carigs.fitting.levenberg_marquardt import Bounds, minimise
from carigs.head import HeadModel, HeadParameters, SurfacePoints
from carigs.mesh.triangle_mesh import vertex_normals
from carigs.tracking.cameras import Cameras
from carigs.tracking.eyeballs import with_rigid_eyeballs
from carigs.tracking.skin.between_views import SimultaneousViews, SkinPoints
from carigs.tracking.solver.objective import LandmarkObjective, Shared
from carigs.tracking.solver.priors import Motion, tracking_prior
from carigs.tracking.solver.tracks import OUTLIERS, Tracks, face_size, information, landmark_sigma
from carigs.tracking.surface_fields import SurfaceField

OFFSET = 0.003
"""Standard deviation in metres of the offset of a landmark on this person's head from where the embedding has it."""
SHAPE_WIDTH, SHAPE_STIFFNESS = 0.012, 0.1
"""Of the field that takes the person's shape from these offsets, stiffer than that of expressions: a network marks
other points of the skin than the embedding has, by a millimetre and each landmark for itself. A field that followed
every offset made bumps of this, which caricatures enlarge."""
ANCHOR_OFFSET = 0.01
"""The same of an anchor of the skull, which is known in the images and not on the head."""
SKIN_OFFSET, SKIN_SIGMA = 0.006, 0.3
"""The same of a point of the skin that several cameras see, and its standard deviation in pixels."""
SKIN_WIDTH = 0.012
"""Metres over which the surface follows points of the skin."""
VIEW_ERROR, VIEW_ROUNDS = 0.01, 2
"""Standard deviation of a landmark's error that is the same in all frames of a camera, in sizes of the face's box, and
times that it is estimated in turn with the rest. A network is off from the side in one way: without this, what the
cameras of two people showed of the skin differed by 10 % more."""
LEAST_FRAMES = 8
"""Frames from which such an error is told from others."""
LEAST_TIMESTEPS = 1 / 8
"""Share of the timesteps in which a point of the skin must be known."""
CHART_SIDES = (96, 160)
"""Pixels along the sides of the charts in which points of the skin are found, one after the other."""
SHARED_TOLERANCE = 1e-3
"""Share of the cost by which a step must reduce it for the solver to go on. The steps are dear here, and the last ones
move landmarks by hundredths of a pixel."""
STEPS, FIRST_STEPS = 25, 8
"""Most steps of the solver in the last passes, and in those whose result is the start of others."""


@dataclass(frozen=True)
class SharedEstimate:
    """What all frames share, and parameters of the frames that it was estimated from."""

    frames: Float[np.ndarray, "m q"]
    shape: Float[np.ndarray, " b"]
    offsets: Float[np.ndarray, "n 3"]
    """Of the landmarks and the anchors, in metres."""
    static_offset: Float[np.ndarray, "v 3"]
    """Smooth displacements of the vertices, in metres."""
    camera: Float[np.ndarray, " k"]
    """Parameters of the cameras."""
    sigma: float
    """Standard deviation of the landmarks in pixels."""
    view_errors: Float[np.ndarray, "c n 2"]
    """What the landmarks of each camera are off in all frames alike, in pixels."""


@dataclass(frozen=True)
class SharedProblem:
    """The landmarks of some frames, and what is known of the head before."""

    model: HeadModel
    fitted: FittedParameters
    embedding: SurfacePoints
    """The landmarks on the model."""
    points: HeadPoints
    """The landmarks, and the anchors after them."""
    tracks: Tracks
    chosen: Int[np.ndarray, " m"]
    """Positions of these frames among all."""
    cameras: Cameras
    motion: Motion
    focal: Float[np.ndarray, " l"]
    """Standard deviation of the logarithm of each lens's focal length."""
    bounds: Bounds

    def estimate(
        self, frames: Float[np.ndarray, "m q"], sigma: float, views: SimultaneousViews | None
    ) -> SharedEstimate:
        """Estimate by the landmarks; of several cameras, by the skin as well.

        Args:
            frames: Start.
            sigma: First standard deviation of the landmarks, in pixels.
            views: What several cameras recorded; None for one.

        Returns:
            The estimate.
        """
        n, count = len(self.embedding), self.tracks.pixels.shape[2]
        vector = np.zeros(len(self.fitted.shape) + self.cameras.size)
        deviations = np.repeat([OFFSET, ANCHOR_OFFSET], [n, count - n])
        passes = (0, OUTLIERS[0], FIRST_STEPS), (count, OUTLIERS[0], FIRST_STEPS), (count, OUTLIERS[1], STEPS)
        for moving, outlier, steps in passes:
            if moving and len(vector) < self._shared(moving).size:
                vector = np.insert(vector, len(self.fitted.shape), np.zeros(3 * moving))
            weights = information(sigma, n, count)
            objective = self._objective(self.points, self.tracks, moving, deviations, weights, outlier)
            frames, vector = self._minimised(objective, frames, vector, steps)
            sigma = landmark_sigma(objective.errors(frames, vector)[:, :, :n])
        shape, offsets, camera = self._shared(count).split(vector)
        static_offset = with_rigid_eyeballs(self.model, self._own_shape(self.vertices(shape)).fit(offsets[:n]))
        nothing = np.zeros((*self.tracks.pixels.shape[1:3], 2))
        found = SharedEstimate(frames, shape, offsets, static_offset, camera, sigma, nothing)
        for side in CHART_SIDES if views is not None else ():
            skin = views.skin_points(
                self.model, self._parameters(found), self.cameras.moved(found.camera), self.chosen, side
            )
            if skin is None or not skin.known.any():
                break
            found = self._with_skin(found, skin)
        return found

    def _with_skin(self, found: SharedEstimate, skin: SkinPoints) -> SharedEstimate:
        """Estimate again, by the landmarks and by points of the skin."""
        n, m = len(self.embedding), len(skin.points)
        points = HeadPoints(self.model, self.fitted, self.embedding.joined(skin.points)).merged()
        pixels = np.concatenate([self.tracks.pixels, skin.pixels], axis=2)
        tracks = Tracks(pixels, np.concatenate([self.tracks.confidence, skin.known], axis=2), self.tracks.times)
        deviations = np.repeat([OFFSET, SKIN_OFFSET], [n, m])
        weights = np.concatenate([information(found.sigma, n, n), information(SKIN_SIGMA, m, m)])
        objective = self._objective(points, tracks, n + m, deviations, weights, OUTLIERS[1])
        before = np.concatenate([found.offsets, skin.points.interpolate(found.static_offset)])
        start = np.concatenate([found.shape, before.ravel(), found.camera])
        frames, vector = self._minimised(objective, found.frames, start, STEPS)
        view_errors = np.zeros((*skin.known.shape[1:2], n + m, 2))
        for _ in range(VIEW_ROUNDS if len(frames) >= LEAST_FRAMES else 0):
            view_errors[:, :n] = self._view_errors(replace(objective, pixels=pixels), frames, vector)
            weights[:n] = information(landmark_sigma(objective.errors(frames, vector)[:, :, :n]), n, n)
            objective = self._objective(points, tracks.less(view_errors), n + m, deviations, weights, OUTLIERS[1])
            frames, vector = self._minimised(objective, frames, vector, FIRST_STEPS)
        shape, offsets, camera = self._shared(n + m).split(vector)
        sigma = landmark_sigma(objective.errors(frames, vector)[:, :, :n])
        vertices = self.vertices(shape)
        static_offset = self._own_shape(vertices).fit(offsets[:n])
        static_offset += self._along_normals(vertices, static_offset, skin, offsets[n:])
        static_offset = with_rigid_eyeballs(self.model, static_offset)
        return SharedEstimate(frames, shape, offsets[:n], static_offset, camera, sigma, view_errors[:, :n])

    def _view_errors(
        self, objective: LandmarkObjective, frames: Float[np.ndarray, "m q"], vector: Float[np.ndarray, " s"]
    ) -> Float[np.ndarray, "c n 2"]:
        """The most probable errors that landmarks of a camera have in all frames alike."""
        n = len(self.embedding)
        errors, weights = objective.weighted_errors(frames, vector)
        weights = weights[:, :, :n, 0, 0]  # of errors without a direction
        precision = weights.sum(axis=0) + (VIEW_ERROR * face_size(self.tracks)) ** -2
        return (weights[..., None] * errors[:, :, :n]).sum(axis=0) / precision[..., None]

    def _along_normals(
        self,
        vertices: Float[np.ndarray, "v 3"],
        static_offset: Float[np.ndarray, "v 3"],
        skin: SkinPoints,
        offsets: Float[np.ndarray, "m 3"],
    ) -> Float[np.ndarray, "v 3"]:
        """What points of the skin add to the surface: several cameras tell where it is, not what slides along it."""
        often = (skin.known > 0).any(axis=1).mean(axis=0) >= LEAST_TIMESTEPS
        if not often.any():
            return np.zeros_like(static_offset)
        points, normals = skin.points[np.flatnonzero(often)], vertex_normals(vertices, self.model.faces)
        directions = points.interpolate(normals)
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        height = ((offsets[often] - points.interpolate(static_offset)) * directions).sum(axis=1, keepdims=True)
        return SurfaceField(vertices, self.model.faces, points, width=SKIN_WIDTH).fit(height) * normals

    def _parameters(self, found: SharedEstimate) -> Sequence[HeadParameters]:
        each = (self.fitted.head_parameters(self.model, frame, found.shape) for frame in found.frames)
        return [replace(parameters, static_offset=found.static_offset) for parameters in each]

    def vertices(self, shape: Float[np.ndarray, " b"]) -> Float[np.ndarray, "v 3"]:
        """The neutral head of an identity.

        Args:
            shape: Shape coefficients.

        Returns:
            Metres.
        """
        return self.model.v_template + self.model.identity_basis[:, :, self.fitted.shape] @ shape

    def _own_shape(self, vertices: Float[np.ndarray, "v 3"]) -> SurfaceField:
        """The field that takes the person's shape from offsets of landmarks."""
        faces = self.model.faces
        return SurfaceField(vertices, faces, self.embedding, width=SHAPE_WIDTH, stiffness=SHAPE_STIFFNESS)

    def _shared(self, moving: int) -> Shared:
        return Shared(len(self.fitted.shape), moving, self.cameras.size)

    def _objective(
        self,
        points: HeadPoints,
        tracks: Tracks,
        moving: int,
        deviations: Float[np.ndarray, " n"],
        weights: Float[np.ndarray, " n"],
        outlier: float,
    ) -> LandmarkObjective:
        shared = self._shared(moving)
        prior = tracking_prior(self.model, self.fitted, tracks.times, shared, self.motion, deviations, self.focal)
        return tracks.objective(points, self.cameras, shared, weights, outlier, prior)

    def _minimised(
        self,
        objective: LandmarkObjective,
        frames: Float[np.ndarray, "m q"],
        vector: Float[np.ndarray, " s"],
        steps: int,
    ) -> tuple[Float[np.ndarray, "m q"], Float[np.ndarray, " s"]]:
        return minimise(objective, frames, vector, steps=steps, tolerance=SHARED_TOLERANCE, bounds=self.bounds)
