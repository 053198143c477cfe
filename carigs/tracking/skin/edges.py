"""Edges of lids and lips: blendshapes of one person's own that hold them where landmarks see them.

A blink takes three frames, and its lids show and hide skin: neither the blendshapes of a head model, corrected in
proportion, nor the texture of the skin follows them. On footage of a person, lids that the network saw 0.6 pixels from
each other stayed 1.8 pixels apart. Lips do follow, and stayed 1.5 pixels apart when they were closed, because the shape
of the head is smooth: they are brought to where they are seen in the middle of all frames. Held in every frame, they
were less sharp.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from carigs.detection.mesh_indices import LEFT_EYE, LIPS_INNER, LIPS_OUTER, RIGHT_EYE
from carigs.head import HeadModel, HeadParameters, SurfacePoints, neutral
from carigs.head.posing import pose_frames
from carigs.tracking.cameras import Cameras
from carigs.tracking.own_blendshapes import principal_shapes, skinning_turns, with_own_blendshapes
from carigs.tracking.surface_fields import SurfaceField

LIDS = (*LEFT_EYE, *RIGHT_EYE)
"""Landmarks of the edges of the lids."""
EDGES = (*LIDS, *LIPS_INNER, *LIPS_OUTER)
"""Those, and landmarks of the edges of the lips."""
MODES = 12
"""Most blendshapes."""
TIMESTEPS_PER_MODE = 8
"""Fewest timesteps for each of them."""
WIDTH = 0.004
"""Metres over which the skin follows an edge."""


def edge_expressions(
    model: HeadModel,
    parameters: Sequence[HeadParameters],
    cameras: Cameras,
    edges: SurfacePoints,
    lids: Bool[np.ndarray, " n"],
    pixels: Float[np.ndarray, "t c n 2"],
) -> tuple[HeadModel, list[HeadParameters]]:
    """Add blendshapes that move the edges, the principal components of what landmarks say of them in the frames.

    Args:
        model: The head model.
        parameters: Those of each timestep.
        cameras: The cameras.
        edges: Landmarks on the edges of lids and lips.
        lids: Which of them are on lids.
        pixels: Where they are in the images; NaN where they do not count.

    Returns:
        The model with more expressions, and parameters with their coefficients. Both are as they were if there are too
        few timesteps or landmarks.
    """
    count = min(MODES, len(parameters) // TIMESTEPS_PER_MODE)
    if not count or not len(edges):
        return model, list(parameters)
    moved = _displacements(model, parameters, cameras, edges, pixels)
    moved[:, ~lids] = np.median(moved[:, ~lids], axis=0)
    shapes, coefficients = principal_shapes(moved, count)
    field = SurfaceField(neutral(model, parameters[0]), model.faces, edges, width=WIDTH)
    on_mesh = field.fit(shapes.reshape(len(edges), -1)).reshape(-1, 3, count)
    return with_own_blendshapes(model, parameters, on_mesh, coefficients)


def _displacements(
    model: HeadModel,
    parameters: Sequence[HeadParameters],
    cameras: Cameras,
    edges: SurfacePoints,
    pixels: Float[np.ndarray, "t c n 2"],
) -> Float[np.ndarray, "t n 3"]:
    """The shortest displacements on the neutral head by which the points come to lie where landmarks see them."""
    posed = pose_frames(model, parameters)
    positions = np.stack([edges.interpolate(vertices) for vertices in posed])
    projected, _, by_point, _ = cameras.linearise(positions)
    off = pixels - projected
    known = np.isfinite(off).all(axis=-1)
    turned = skinning_turns(model, parameters, edges.interpolate(model.weights))
    by_rest = by_point @ turned[:, None]
    rows = np.where(known[..., None, None], by_rest, 0).swapaxes(1, 2)  # (t, n, c, 2, 3)
    t, n = rows.shape[:2]
    values = np.where(known[..., None], off, 0).swapaxes(1, 2).reshape(t, n, -1, 1)
    moved = (np.linalg.pinv(rows.reshape(t, n, -1, 3), rcond=1e-3) @ values)[..., 0]
    seen = known.any(axis=1)
    # Where no camera sees a landmark, it is as far off as in most frames.
    usual = np.ma.median(np.ma.array(moved, mask=np.broadcast_to(~seen[..., None], moved.shape)), axis=0).filled(0)
    return np.where(seen[..., None], moved, usual)
