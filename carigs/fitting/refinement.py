"""Refinement of a fit to landmarks on outlines and on photometric agreement.

| stage | observations beside the landmarks | what changes |
|---|---|---|
| 1 | outline of the posed mesh against the mattes | shape, expressions, poses |
| 2 | the same, and the images at points of the skin against the mean over cameras and timesteps | expressions, poses |

Shading that changes with the view, and the background that the blur carries into grazing views, pull all frames the
same way. They would change the shape for the worse, therefore the second stage leaves it as it is.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32

from carigs.capture import Capture
from carigs.capture.evenly_spread import evenly_spread
from carigs.fitting.compared_vertices import compared_vertices
from carigs.fitting.head_points import HeadPoints
from carigs.fitting.landmarks.fit import HeadFit, Observations, gaussian_prior, landmark_term
from carigs.fitting.levenberg_marquardt import minimise
from carigs.fitting.objective import Objective
from carigs.fitting.outline_term import OutlineLines, OutlineTerm, outline_lines
from carigs.fitting.photometric_term import PhotometricTerm, sample_with_gradient
from carigs.fitting.scattered_costs import seen_from
from carigs.head import HeadModel, SurfacePoints, pose_frames, subject_model
from carigs.mesh.triangle_mesh import vertex_normals
from carigs.raster import compute_visibility
from carigs.raster.vertex_colours import visible_vertices

OUTLINE_ROUNDS = 3
SETTLED = 0.0005
"""Metres that a round moves the compared vertices on average, below which it is the last."""
STEPS, TOLERANCE = 5, 1e-4
"""Of a minimisation: more is of no use before the outline is found again."""
LEAST_COSINE = 0.7
"""Between the normal of a compared vertex and the direction to the camera."""
BLUR = (1.0, 4.0)
"""Pixels: images are band-pass filtered by the difference of two Gaussians, which removes noise and shading."""
LEAST_VALUES = 6
"""Frames that must show a vertex."""
NOISE = 0.004
"""Least standard deviation of filtered values, in units of white."""
MEAN_TIMESTEPS = 64
"""Timesteps that means are computed from."""
CHUNK = 16
"""Timesteps whose images are held at a time."""


class Refinement:
    """What all stages share: the capture, its landmarks, and the compared vertices.

    Args:
        capture: Images and mattes; head parameters are not read.
        timesteps: Timesteps of the fit.
        cameras: Numbers of the cameras, in the order of the observations.
        model: The head model.
        landmarks: The landmarks on the head.
        observations: The landmarks in the images.
        on_frame: Called after each timestep of each pass over the frames.
    """

    def __init__(
        self,
        capture: Capture,
        timesteps: list[int],
        cameras: list[int],
        model: HeadModel,
        landmarks: SurfacePoints,
        observations: Observations,
        on_frame: Callable[[], None] = lambda: None,
    ) -> None:
        self.capture, self.timesteps, self.cameras, self.model = capture, timesteps, cameras, model
        self.landmarks, self.observations = landmarks, observations
        self.on_frame = on_frame
        self.vertices = compared_vertices(model)

    def refine(self, fit: HeadFit) -> HeadFit:
        """Refine on outlines, then on photometric agreement.

        Args:
            fit: The fit to landmarks.

        Returns:
            The refined fit.
        """
        return self.refine_images(self.refine_outlines(fit))

    def refine_outlines(self, fit: HeadFit) -> HeadFit:
        """Refine shape, expressions and poses on the mattes.

        Args:
            fit: The fit to landmarks.

        Returns:
            The refined fit.
        """
        for _ in range(OUTLINE_ROUNDS):
            before, fit = fit, self._fit_outlines(fit)
            points = self._points(self.model, fit)[1]
            moved = points.positions(fit.frames, fit.shape) - points.positions(before.frames, before.shape)
            if np.linalg.norm(moved, axis=-1).mean() < SETTLED:
                break
        return fit

    def refine_images(self, fit: HeadFit) -> HeadFit:
        """Refine expressions and poses on the images and mattes; the shape stays as it is.

        Args:
            fit: The fit.

        Returns:
            The refined fit.
        """
        subject = subject_model(self.model, fit.parameters(self.model)[0])
        fixed = replace(fit, fitted=replace(fit.fitted, shape=fit.fitted.shape[:0]), shape=fit.shape[:0])
        landmarks, points = self._points(subject, fixed)
        visible = np.zeros((len(self.timesteps), len(self.cameras), len(self.vertices)), bool)
        outlines = self._look(fit, points, visible)
        means, sigma = self._means(fixed, points, visible)
        visible &= np.isfinite(means)
        frames = fit.frames.copy()
        for first in range(0, len(frames), CHUNK):
            part = slice(first, min(first + CHUNK, len(frames)))
            observations = _part(self.observations, part)
            inside = (outlines.frame >= part.start) & (outlines.frame < part.stop)
            terms = [
                landmark_term(landmarks, observations, fit.sigma),
                OutlineTerm(
                    points,
                    observations.projections,
                    outlines.frame[inside] - first,
                    outlines.camera[inside],
                    OutlineLines(*(array[inside] for array in outlines.lines)),
                ),
                PhotometricTerm(points, self._images(part), visible[part], means, sigma, observations.projections),
            ]
            prior = gaussian_prior(fixed.fitted, observations.linked)
            frames[part], _ = minimise(
                Objective(terms, prior), frames[part], fixed.shape, steps=STEPS, tolerance=TOLERANCE
            )
        return replace(fit, frames=frames)

    def _fit_outlines(self, fit: HeadFit) -> HeadFit:
        landmarks, points = self._points(self.model, fit)
        terms = [landmark_term(landmarks, self.observations, fit.sigma), self._look(fit, points)]
        prior = gaussian_prior(fit.fitted, self.observations.linked)
        frames, shape = minimise(Objective(terms, prior), fit.frames, fit.shape, steps=STEPS, tolerance=TOLERANCE)
        return replace(fit, frames=frames, shape=shape)

    def _points(self, model: HeadModel, fit: HeadFit) -> tuple[HeadPoints, HeadPoints]:
        """Landmarks and compared vertices."""
        compared = SurfacePoints.at_vertices(self.vertices)
        return HeadPoints(model, fit.fitted, self.landmarks), HeadPoints(model, fit.fitted, compared)

    def _look(self, fit: HeadFit, points: HeadPoints, visible: Bool[np.ndarray, "t c n"] | None = None) -> OutlineTerm:
        """Find the outlines of all frames, and mark in `visible` which compared vertices they show well."""
        position = np.full(len(self.model.v_template), -1)
        position[self.vertices] = np.arange(len(self.vertices))
        frames, cameras, lines = [], [], []
        for t, (timestep, vertices) in enumerate(zip(self.timesteps, self._posed(fit), strict=True)):
            normals = vertex_normals(vertices, self.model.faces)
            for c, camera in enumerate(self.cameras):
                frame = self.capture.frame_at.get((timestep, camera))
                if frame is None:
                    continue
                visibility = compute_visibility(vertices, self.model.faces, self.capture.camera(frame))
                if visible is not None:
                    seen = visible_vertices(visibility, vertices, normals)
                    found = position[seen.index[seen.cosine > LEAST_COSINE]]
                    visible[t, c, found[found >= 0]] = True
                if frame.mask is not None:
                    matte = self.capture.mask(frame)
                    lines.append(outline_lines(visibility, normals, matte, self.vertices))
                    frames.append(np.full(len(lines[-1].point), t))
                    cameras.append(np.full(len(lines[-1].point), c))
            self.on_frame()
        if not lines:
            empty = np.zeros(0, int)
            nothing = OutlineLines(empty, np.zeros((0, 2)), np.zeros(0), np.zeros(0))
            return OutlineTerm(points, self.observations.projections, empty, empty, nothing)
        joined = OutlineLines(*map(np.concatenate, zip(*lines, strict=True)))
        frame, camera = np.concatenate(frames), np.concatenate(cameras)
        return OutlineTerm(points, self.observations.projections, frame, camera, joined)

    def _posed(self, fit: HeadFit) -> Iterator[Float[np.ndarray, "v 3"]]:
        """Vertices of each frame."""
        parameters = fit.parameters(self.model)
        for first in range(0, len(parameters), CHUNK):
            yield from pose_frames(self.model, parameters[first : first + CHUNK])

    def _means(
        self, fit: HeadFit, points: HeadPoints, visible: Bool[np.ndarray, "t c n"]
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Median value of each compared vertex and its standard deviation; NaN where few frames show it."""
        t = len(self.timesteps)
        some = evenly_spread(range(t), MEAN_TIMESTEPS)
        values = np.full((len(some), *visible.shape[1:]), np.nan, np.float32)
        for i, k in enumerate(some):
            part = slice(k, k + 1)
            positions = points.positions(fit.frames[part], fit.shape)[0]
            camera, point = np.nonzero(visible[k])
            pixels, _ = seen_from(self.observations.projections[k, camera], positions[point])
            values[i, camera, point], _ = sample_with_gradient(
                self._images(part), np.zeros_like(camera), camera, pixels
            )
        values = values.reshape(-1, visible.shape[2])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # vertices that no frame shows
            means = np.nanmedian(values, axis=0).astype(np.float64)
            sigma = np.hypot(1.4826 * np.nanmedian(np.abs(values - means), axis=0), NOISE)
        means[np.isfinite(values).sum(axis=0) < LEAST_VALUES] = np.nan
        return means, sigma

    def _images(self, part: slice) -> Float32[np.ndarray, "t c h w"]:
        """Band-passed grey images; 0 for missing frames."""
        frames = [[self.capture.frame_at.get((t, c)) for c in self.cameras] for t in self.timesteps[part]]
        known = [self.capture.camera(frame) for row in frames for frame in row if frame]
        height, width = max(camera.height for camera in known), max(camera.width for camera in known)
        images = np.zeros((len(frames), len(self.cameras), height, width), np.float32)
        for row, target in zip(frames, images, strict=True):
            for frame, image in zip(row, target, strict=True):
                if frame is not None:
                    grey = cv2.cvtColor(self.capture.image(frame), cv2.COLOR_RGB2GRAY)
                    fine, coarse = (cv2.GaussianBlur(grey, (0, 0), sigma) for sigma in BLUR)
                    image[: grey.shape[0], : grey.shape[1]] = fine - coarse
            self.on_frame()
        return images


def _part(observations: Observations, part: slice) -> Observations:
    linked = observations.linked[part.start : part.stop - 1]
    arrays = (observations.pixels, observations.confidence, observations.projections)
    return Observations(*(array[part] for array in arrays), linked)
