"""Images of exact mode: one variant, two with a divider between them, or the error of an image."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, UInt8

from carigs.capture import Camera
from carigs.viewer.exact_mode import cropped, exact_image, pixels, split_image
from carigs.viewer.options import Options
from carigs.viewer.overlays import draw_mesh, error_image, fit_into
from carigs.viewer.state import Values, without_exaggeration
from carigs.viewer.subject import Subject


def composed_image(
    subject: Subject, values: Values, stored: Values, options: Options, camera: Camera, *, settled: bool
) -> tuple[UInt8[np.ndarray, "h w 3"], str]:
    """Render what a client asks for.

    Args:
        subject: The avatars and what they are compared with.
        values: Values of the controls.
        stored: Values that the client has kept.
        options: What to show.
        camera: The view.
        settled: Whether shading must be that of these values, see `HeadScene.surfels`.

    Returns:
        RGB from 0 to 255, and a remark for the status line.
    """
    background = subject.avatar.avatar.background
    if options.overlay == "error":
        image = _render(subject, 0, values, options, camera, settled)
        truth = None if options.camera is None else subject.truth(options.camera, values)
        if truth is None:
            return pixels(image), ", no truth: choose a camera and a level that it has"
        colours, psnr = error_image(image, fit_into(truth, camera.width, camera.height, background))
        return pixels(colours), f", PSNR {psnr:.2f} dB"
    column = round(options.divider * camera.width)
    right = _right_part(subject, values, stored, options, camera, settled)
    if right is None:
        image = _render(subject, 0, values, options, camera, settled)
    elif column == 0:
        image = right
    else:
        image = split_image(_render(subject, 0, values, options, cropped(camera, 0, column), settled), right)
    image = pixels(image)
    if options.overlay == "mesh":
        draw_mesh(image, subject.scenes[0].vertices(values), subject.avatar.avatar.sequence.head.faces, camera)
    return image, ""


def _right_part(
    subject: Subject, values: Values, stored: Values, options: Options, camera: Camera, settled: bool
) -> Float32[np.ndarray, "h w 3"] | None:
    """The image right of the divider; None if the view is not split or there is nothing to compare with."""
    column, scene, other = round(options.divider * camera.width), 0, values
    if options.split == "off":
        return None
    if options.split == "captured image":
        captured = None if options.camera is None else subject.captured(options.camera, values)
        if captured is None:
            return None
        return fit_into(captured, camera.width, camera.height, subject.avatar.avatar.background)[:, column:]
    if column == camera.width:
        return np.empty((camera.height, 0, 3), np.float32)
    if options.split == "natural head":
        other = without_exaggeration(values)
    elif options.split == "stored values":
        other = {**stored, "frame": values["frame"]}
    else:
        scene = 1
    return _render(subject, scene, other, options, cropped(camera, column, camera.width), settled)


def _render(
    subject: Subject, number: int, values: Values, options: Options, camera: Camera, settled: bool
) -> Float32[np.ndarray, "h w 3"]:
    scene, colours = subject.scenes[number], subject.face_colours(options.overlay, number)
    world = scene.surfels(values, camera.centre, settled=settled, face_colours=colours)
    return exact_image(world, camera, scene.avatar.avatar.background)
