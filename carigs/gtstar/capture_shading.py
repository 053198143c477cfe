"""The light of a capture, fitted to the skin in some of its training frames."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, UInt16

from carigs.capture import Capture
from carigs.capture.evenly_spread import evenly_spread
from carigs.gtstar.frame_views import TimestepViews, load_views
from carigs.gtstar.mask_flags import MaskFlag
from carigs.head import pose
from carigs.light.fitting import DIRECTIONS, Observation, fit_light, observe_skin
from carigs.light.shading import Shading
from carigs.settings import Gtstar

KEPT = MaskFlag.HAIR | MaskFlag.EYEBALLS | MaskFlag.MOUTH
"""Triangles whose colours do not depend on their own normals: hair strands, glossy eyes, teeth."""
TIMESTEPS = 9
"""Timesteps, evenly spread, that the light is fitted to."""
RELIGHT_STRENGTH, RELIGHT_LIMIT = 0.85, 2.0
"""Exponent of the ratio of new to old irradiance, and the largest factor on linear colours; the smallest is its
inverse."""
CACHE_BYTES = 512 << 20
"""Memory for views that are kept for the targets."""


def fit_capture_shading(
    settings: Gtstar,
    capture: Capture,
    face_flags: UInt16[np.ndarray, " f"],
    map_timesteps: Callable = map,
    cache: dict[int, TimestepViews] | None = None,
    num_directions: int = DIRECTIONS,
    clean: Bool[np.ndarray, " f"] | None = None,
) -> Shading | None:
    """Fit the light of a capture.

    Args:
        settings: Settings of the stage.
        capture: The capture.
        face_flags: Flags of the triangles; those without any are skin.
        map_timesteps: `map`, or that of an executor; the result does not depend on it.
        cache: Receives the views of the timesteps, up to `CACHE_BYTES`, so that they need not be loaded again.
        num_directions: Number of directions of the light.
        clean: Triangles that nothing covers (`FoundHair.clean`); None for all.

    Returns:
        The shading, or None if nothing is relit.
    """
    if settings.provider != "lat" or settings.relight == "none":
        return None
    model, frames = capture.model, capture.split("train")
    skin = np.ones(len(model.v_template), bool)
    skin[model.faces[face_flags > 0]] = False
    if clean is not None:
        skin[model.faces[~clean]] = False
    timesteps = sorted({frame.timestep for frame in frames})
    fitted = evenly_spread(timesteps, TIMESTEPS)
    groups = {timestep: [frame for frame in frames if frame.timestep == timestep] for timestep in fitted}
    cached = set(fitted[: CACHE_BYTES // max(_view_bytes(capture, group) for group in groups.values())])

    def observe(timestep: int) -> Observation:
        views = load_views(settings, capture, groups[timestep], pose(model, capture.parameters(timestep)))
        if cache is not None and timestep in cached:
            cache[timestep] = views
        pairs = [(view.image, view.natural) for view in views.views.values()]
        return observe_skin(pairs, views.vertices, model.faces, skin)

    directions, light = fit_light(list(map_timesteps(observe, fitted)), model.faces, map_timesteps, num_directions)
    kept = (face_flags & np.uint16(KEPT.value)) > 0
    return Shading(directions, light, RELIGHT_STRENGTH, RELIGHT_LIMIT, kept, settings.hair_extinction)


def _view_bytes(capture: Capture, frames: list) -> int:
    """Memory of the views of a timestep: 24 bytes per pixel and about 48 per face."""
    cameras = [capture.camera(frame) for frame in frames]
    return sum(24 * camera.width * camera.height + 48 * len(capture.model.faces) for camera in cameras)
