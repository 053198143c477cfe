"""Where edits are allowed: regions of the head model, as triangles and as pixels of a view."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32

from carigs.capture import Camera
from carigs.errors import SettingsError
from carigs.head import HeadModel
from carigs.raster import compute_visibility

MARGIN = 0.2
"""Width by which the mask of an image reaches beyond the region, over the larger side of the region's rectangle there:
a nose that grows covers more than its own pixels."""
FEATHER = 0.5
"""Width over which the mask falls to 0, over that margin."""


def edited_faces(model: HeadModel, regions: Sequence[str]) -> Bool[np.ndarray, " f"] | None:
    """Find the triangles to which edits are confined.

    Args:
        model: The head model.
        regions: Names of its regions.

    Returns:
        The triangles; None without regions: edits are allowed everywhere.

    Raises:
        SettingsError: The model has no region of such a name.
    """
    if unknown := [name for name in regions if name not in model.regions]:
        known = ", ".join(sorted(model.regions))
        raise SettingsError(f"train.edit.regions: the head model has no region {unknown[0][:60]}; it has {known}")
    return model.face_region(*regions) if regions else None


def edited_pixels(
    model: HeadModel, vertices: Float[np.ndarray, "v 3"], camera: Camera, faces: Bool[np.ndarray, " f"]
) -> Float32[np.ndarray, "h w"]:
    """Find the pixels to which an edit is confined.

    Args:
        model: The head model.
        vertices: The head in world coordinates, in metres.
        camera: The view.
        faces: Triangles of the regions.

    Returns:
        Weight of the edit: 1 on what the view shows of the regions and `MARGIN` around, then falling to 0; 0
        everywhere where it shows none of them.
    """
    face = compute_visibility(vertices, model.faces, camera).face
    shown = (face >= 0) & faces[face]
    if not shown.any():
        return np.zeros(shown.shape, np.float32)
    rows, columns = np.flatnonzero(shown.any(axis=1)), np.flatnonzero(shown.any(axis=0))
    margin = MARGIN * (1 + max(np.ptp(rows), np.ptp(columns)))
    distance = cv2.distanceTransform((~shown).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.clip((margin * (1 + FEATHER) - distance) / (margin * FEATHER), 0, 1).astype(np.float32)


def confined(
    edited: Float32[np.ndarray, "h w 3"],
    captured: Float32[np.ndarray, "h w 3"],
    weight: Float32[np.ndarray, "h w"],
) -> Float32[np.ndarray, "h w 3"]:
    """Confine an edit to a mask.

    Args:
        edited: The edited image.
        captured: The image of the capture.
        weight: Weight of the edit.

    Returns:
        The captured image where the weight is 0, the edited one where it is 1, and mixtures between.
    """
    return np.where(weight[..., None] > 0, captured + weight[..., None] * (edited - captured), captured)
