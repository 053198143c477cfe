"""The map from landmarks to pixels that lets a rigid head explain them.

A map is pixel = scale * landmark + offset, with a scale for x and one for y, the same in all images. The unknowns are
the map, the pose of the mean head in each timestep, and its size, because the cameras may be in another unit than the
head. All are found together, by least squares with a loss that grows linearly. Cameras around the head determine which
landmark coordinates lie in the middle of the images (else the rays of a landmark do not meet) and, with the head's
proportions, the ratio of the scales; the scale itself hardly, as a larger head has the same images. A `Form` says which
maps one mistake can give, and has so few unknowns that they are determined.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from carigs.fitting.triangulation import LEAST_POINTS, project, triangulate
from carigs.mesh.rigid_alignment import rigid_alignment

STEPS = 20
"""Evaluations of the Jacobian at most."""
TOLERANCE = 1e-4
LOSS_SCALE = 0.05
"""Error from which the loss grows linearly, in sizes of the face."""
STIFFNESS = 0.01
"""Error, in sizes of the face, that counts as much as a head that is e times as large as at the start: where nothing
else determines the size, it stays."""
FARTHEST = 1e6
"""Pixels from the corner of the image up to which a map is possible."""
LARGEST_CHANGE = 5.0
"""Logarithm of a change of the head's size that a fit never needs, but a failing one would overflow with."""
START = 0.2
"""Size of the face from which the fit starts if the scale is unknown, in sizes of the image."""

Sizes = Float[np.ndarray, "t c 1 2"]
"""Width and height of the images."""


class Views(NamedTuple):
    """Landmarks in images, in a unit of their own, and the cameras."""

    landmarks: Float[np.ndarray, "t c p 2"]
    seen: Bool[np.ndarray, "t c p"]
    projections: Float[np.ndarray, "t c 3 4"]
    sizes: Sizes


class ImageMap(NamedTuple):
    """pixel = scale * landmark + offset."""

    scale: Float[np.ndarray, "*images 2"]
    offset: Float[np.ndarray, "*images 2"]


class Form(NamedTuple):
    """The maps that one mistake can give."""

    image_map: Callable[[Float[np.ndarray, " k"], Sizes], ImageMap]
    """From logarithms of scales, then offsets in mean sizes of the images."""
    scales: int
    """Number of unknown scales."""
    offsets: int = 0
    """Number of unknown offsets."""


class OwnForm(NamedTuple):
    """Each image has an offset of its own, and a scale of its own if `scaled`."""

    scaled: bool


class MapFit(NamedTuple):
    """A head and a map that fit the landmarks best."""

    head_error: float
    """Median distance in the images between landmarks and the rigid mean head, in sizes of the face there."""
    ray_error: float
    """Median distance in the images between landmarks and their triangulated points, in sizes of the face."""
    head_size: float
    """Size of the head, in sizes of the head model."""
    values: Float[np.ndarray, " k"]
    """Unknowns of the form."""
    image_map: ImageMap

    @property
    def error(self) -> float:
        """Both errors together."""
        return float(np.hypot(self.head_error, self.ray_error))


class _Head(NamedTuple):
    log_size: float
    rotations: Float[np.ndarray, "t 3"]
    translations: Float[np.ndarray, "t 3"]
    """Of the landmarks' mean."""


NOTHING_FITS = MapFit(np.inf, np.inf, 1.0, np.zeros(0), ImageMap(np.ones(2), np.zeros(2)))


def spreads(points: Float[np.ndarray, "*n p d"], seen: Bool[np.ndarray, "*n p"]) -> Float[np.ndarray, "*n d"]:
    """Standard deviations of the coordinates of the seen points.

    Args:
        points: Points.
        seen: Which ones count.

    Returns:
        One for each coordinate; 0 where no point is seen.
    """
    weights = seen / np.maximum(seen.sum(axis=-1, keepdims=True), 1)
    points = np.where(seen[..., None], points, 0)
    centred = points - np.einsum("...p,...pd->...d", weights, points)[..., None, :]
    return np.asarray(np.sqrt(np.einsum("...p,...pd->...d", weights, centred**2)))


def centred_pixels(views: Views) -> Float[np.ndarray, "t c p 2"]:
    """Pixels to start from if the map is not known: each face in the middle of its image.

    Args:
        views: The landmarks.

    Returns:
        Pixels.
    """
    sizes = np.linalg.norm(spreads(views.landmarks, views.seen), axis=-1)
    scale = START * views.sizes.min() / max(float(np.median(sizes[sizes > 0])), 1e-9)
    count = np.maximum(views.seen.sum(axis=2), 1)[..., None, None]
    middle = np.where(views.seen[..., None], views.landmarks, 0).sum(axis=2, keepdims=True) / count
    return scale * (views.landmarks - middle) + views.sizes / 2


def fit_map(
    template: Float[np.ndarray, "p 3"],
    views: Views,
    form: Form | OwnForm,
    values: Float[np.ndarray, " k"],
    pixels: Float[np.ndarray, "t c p 2"],
) -> MapFit:
    """Fit head and map.

    Args:
        template: The landmarks on the head model, in metres.
        views: The landmarks in the images.
        form: The maps that are allowed.
        values: Unknowns of the form to start from.
        pixels: Positions of the landmarks from which the head is triangulated to start.

    Returns:
        The fit; errors are infinite if no head can be triangulated or it lies behind the cameras.
    """
    centre = template.mean(axis=0)
    points = template - centre
    head = _start(points, views, pixels)
    if head is None:
        return NOTHING_FITS
    # Errors are counted in spreads of the landmarks, which hold for every unit: in pixels, a scale of 0 had none.
    spread = _spread(views, same=isinstance(form, OwnForm) or form.scales + form.offsets == 0)
    count, unit = len(values), float(np.exp(head.log_size) * np.sqrt((points**2).sum(axis=1).mean()))
    weight = views.seen[..., None] / spread
    stiffness = STIFFNESS * np.sqrt(2 * views.seen.sum())

    def unpack(x: np.ndarray) -> tuple[np.ndarray, _Head]:
        poses = x[count + 1 :].reshape(-1, 6)
        size = float(np.clip(x[count], head.log_size - LARGEST_CHANGE, head.log_size + LARGEST_CHANGE))
        return x[:count], _Head(size, poses[:, :3], unit * poses[:, 3:])

    def residuals(x: np.ndarray) -> np.ndarray:
        unknown, moved = unpack(x)
        projected, _ = project(_placed(points, moved), views.projections)
        image_map = _image_map(form, unknown, projected, views)
        errors = weight * ((projected - image_map.offset) / image_map.scale - views.landmarks)
        return np.append(errors.ravel(), stiffness * (x[count] - head.log_size))

    start = np.concatenate([values, [head.log_size], np.hstack([head.rotations, head.translations / unit]).ravel()])
    found = least_squares(
        residuals, start, loss="soft_l1", f_scale=LOSS_SCALE, x_scale="jac", max_nfev=STEPS, ftol=TOLERANCE
    ).x
    return _judge(points, views, form, *unpack(found))


def _spread(views: Views, same: bool) -> Float[np.ndarray, "2"]:
    """Spread of the landmarks in an image along x and y, or the same for both."""
    squared = (spreads(views.landmarks, views.seen) ** 2)[views.seen.any(axis=-1)].mean(axis=0)
    return np.sqrt(np.maximum(np.full(2, squared.mean()) if same else squared, 1e-18))


def _placed(points: Float[np.ndarray, "p 3"], head: _Head) -> Float[np.ndarray, "t p 3"]:
    rotations = Rotation.from_rotvec(head.rotations).as_matrix()
    return np.exp(head.log_size) * points @ rotations.transpose(0, 2, 1) + head.translations[:, None]


def _start(points: Float[np.ndarray, "p 3"], views: Views, pixels: Float[np.ndarray, "t c p 2"]) -> _Head | None:
    """The head aligned with triangulated landmarks; None if there are none."""
    targets, _ = triangulate(pixels, views.seen.astype(np.float64), views.projections)
    poses = []
    for target in targets:
        known = np.isfinite(target).all(axis=1)
        if known.sum() < LEAST_POINTS:
            return None
        sizes = [float(np.linalg.norm(p[known] - p[known].mean(axis=0))) for p in (target, points)]
        rotation, translation = rigid_alignment(sizes[0] / sizes[1] * points[known], target[known])
        poses.append((np.log(sizes[0] / sizes[1]), Rotation.from_matrix(rotation).as_rotvec(), translation))
    log_sizes, rotations, translations = (np.array(values) for values in zip(*poses, strict=True))
    return _Head(float(np.median(log_sizes)), rotations, translations)


def _image_map(
    form: Form | OwnForm, values: Float[np.ndarray, " k"], projected: Float[np.ndarray, "t c p 2"], views: Views
) -> ImageMap:
    """The map of a form; that of an `OwnForm` is the best for each image."""
    if isinstance(form, Form):
        return form.image_map(values, views.sizes)
    hidden = ~views.seen[..., None]
    middles = [_median(points, hidden) for points in (projected, views.landmarks)]
    scale: np.ndarray = np.ones((1, 1, 1, 2))
    if form.scaled:
        extents = [
            _median(np.linalg.norm(points - middle, axis=-1, keepdims=True), hidden)
            for points, middle in zip((projected, views.landmarks), middles, strict=True)
        ]
        scale = extents[0] / np.maximum(extents[1], 1e-12) * np.ones(2)
    return ImageMap(scale, middles[0] - scale * middles[1])


def _median(points: Float[np.ndarray, "t c p d"], hidden: Bool[np.ndarray, "t c p 1"]) -> Float[np.ndarray, "t c 1 d"]:
    if not hidden.any():
        return np.asarray(np.median(points, axis=2, keepdims=True))
    masked = np.where(
        hidden | hidden.all(axis=2, keepdims=True), np.where(hidden.all(axis=2, keepdims=True), 1.0, np.nan), points
    )
    return np.asarray(np.nanmedian(masked, axis=2, keepdims=True))


def _judge(
    points: Float[np.ndarray, "p 3"], views: Views, form: Form | OwnForm, values: Float[np.ndarray, " k"], head: _Head
) -> MapFit:
    """Errors of a head and a map."""
    projected, depth = project(_placed(points, head), views.projections)
    image_map = _image_map(form, values, projected, views)
    pixels = image_map.scale * views.landmarks + image_map.offset
    distances = np.linalg.norm(projected - pixels, axis=-1)
    enough = views.seen.sum(axis=-1) >= LEAST_POINTS
    faces = np.linalg.norm(spreads(projected, views.seen), axis=-1)
    if not enough.any() or np.median(depth[enough]) <= 0 or not np.abs(pixels).max() < FARTHEST:
        return NOTHING_FITS
    shares = np.where(views.seen, distances / np.maximum(faces, 1e-9)[..., None], np.nan)
    head_error = float(np.median(np.nanmedian(shares[enough], axis=-1)))
    _, off = triangulate(pixels, views.seen.astype(np.float64), views.projections)
    known = np.isfinite(off)
    ray_error = float(np.median((off / np.maximum(faces, 1e-9)[..., None])[known])) if known.any() else 0.0
    return MapFit(head_error, ray_error, float(np.exp(head.log_size)), values, image_map)
