"""What the viewer lays over a head: colours of triangles, lines of the mesh, and the error of an image."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float, Float32, Float64, Int, UInt8
from matplotlib import colormaps

from carigs.capture import Camera
from carigs.gtstar.flag_colours import FLAG_COLOURS
from carigs.gtstar.mask_flags import face_mask_flags
from carigs.head import subject_exaggerator
from carigs.library import HeadAvatar
from carigs.settings import Exaggerate, Gtstar

GREY = 0.75
"""Of triangles without a flag or a curvature."""
LINE = (40, 230, 50)
"""Colour of the mesh."""
ERROR_SCALE = 4.0
"""Factor on the mean absolute difference of the channels before the colour map."""


def curvature_colours(avatar: HeadAvatar) -> Float32[np.ndarray, "f 3"]:
    """Colours by the stabilised curvature of the neutral head: blue where it is flat, red where it is curved.

    It is ln |K| at the vertices as the exaggeration uses it, where the 2nd to the 98th percentile span the colour map.

    Args:
        avatar: The avatar. Its equation is assembled and factorised, which takes about a second.

    Returns:
        RGB in [0, 1] of every triangle; those of the teeth are grey.
    """
    head = avatar.avatar.sequence.head
    equation = subject_exaggerator(head, head.v_template.astype(np.float64), Exaggerate())
    curvature = equation.face_mean(equation.log_curvature)
    low, high = np.percentile(curvature, [2, 98])
    colours = np.full((len(head.faces), 3), GREY, np.float32)
    colours[: len(curvature)] = colormaps["turbo"]((curvature - low) / max(high - low, 1e-12))[:, :3]
    return colours


def flag_colours(avatar: HeadAvatar) -> Float32[np.ndarray, "f 3"]:
    """Colours by the flags that mask the triangles of targets.

    Args:
        avatar: The avatar.

    Returns:
        RGB in [0, 1] of every triangle: the mean colour of its flags, grey if it has none.
    """
    flags = face_mask_flags(avatar.avatar.sequence.head, Gtstar())
    total, count = np.zeros((len(flags), 3)), np.zeros((len(flags), 1))
    for flag, colour in FLAG_COLOURS.items():
        holds = (flags & np.uint16(flag.value)) > 0
        total[holds] += colour
        count[holds] += 1
    return np.where(count > 0, total / np.maximum(count, 1), GREY).astype(np.float32)


def draw_mesh(
    image: UInt8[np.ndarray, "h w 3"],
    vertices: Float64[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    camera: Camera,
) -> None:
    """Draw the edges of the triangles that face the camera, in place; hidden ones are drawn as well.

    Args:
        image: RGB from 0 to 255.
        vertices: World vertices in metres.
        faces: Vertex indices of the triangles.
        camera: The camera of the image.
    """
    points, depth = camera.project(vertices)
    corners = points[faces]
    (ax, ay), (bx, by) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
    with np.errstate(invalid="ignore"):
        shown = (depth[faces] > 0).all(axis=1) & (ax * by - ay * bx < 0) & (np.abs(corners) < 2e4).all(axis=(1, 2))
    lines = np.rint(16 * (corners[shown] - 0.5)).astype(np.int32)
    layer = image.copy()
    cv2.polylines(layer, list(lines), True, LINE, 1, cv2.LINE_AA, 4)
    cv2.addWeighted(layer, 0.45, image, 0.55, 0, image)


def error_image(
    image: Float32[np.ndarray, "h w 3"], truth: Float32[np.ndarray, "h w 3"]
) -> tuple[Float32[np.ndarray, "h w 3"], float]:
    """The difference of an image from the truth.

    Args:
        image: RGB in [0, 1].
        truth: RGB in [0, 1].

    Returns:
        Mean absolute difference of the channels in colours, black for 0; and the PSNR in dB.
    """
    difference = np.abs(image - truth).mean(axis=2)
    colours = colormaps["inferno"](np.minimum(ERROR_SCALE * difference, 1))[..., :3].astype(np.float32)
    mean_square = float(np.square(image.astype(np.float64) - truth).mean())
    return colours, float("inf") if mean_square == 0 else -10 * float(np.log10(mean_square))


def fit_into(
    image: Float[np.ndarray, "h w 3"], width: int, height: int, background: float
) -> Float32[np.ndarray, "y x 3"]:
    """Scale an image into the middle of another shape, as `exact_mode.fitted` does with its camera.

    Args:
        image: RGB in [0, 1].
        width: New width in pixels.
        height: New height.
        background: Grey value around it.

    Returns:
        RGB in [0, 1].
    """
    h, w = image.shape[:2]
    scale = min(width / w, height / h)
    left, top = 0.5 * (width - scale * w), 0.5 * (height - scale * h)
    if scale < 1:  # against aliasing
        image = cv2.GaussianBlur(image, (0, 0), 0.4 / scale)
    # Of pixel indices, whose centres lie at +0.5.
    matrix = np.array([[scale, 0, left + 0.5 * scale - 0.5], [0, scale, top + 0.5 * scale - 0.5]])
    warped = cv2.warpAffine(
        image.astype(np.float32), matrix, (width, height), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT,
        borderValue=(background,) * 3,
    )  # fmt: skip
    return np.ascontiguousarray(warped)
