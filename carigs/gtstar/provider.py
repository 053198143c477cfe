"""Targets of one timestep: frames warped to the caricature, frames as they are, or a folder of edited frames."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import UInt16

from carigs.capture import Capture, Frame
from carigs.errors import SettingsError
from carigs.exaggeration import Caricature
from carigs.gtstar.by_command import find_program
from carigs.gtstar.frame_views import TimestepViews, load_views
from carigs.gtstar.registration import RegistrationError, registration_errors
from carigs.gtstar.target import Target, make_target
from carigs.hair import CarriedHair
from carigs.head import pose
from carigs.light import Shading, relight
from carigs.raster import compute_visibility
from carigs.settings import Gtstar

LIMIT_OVER_TOLERANCE = 3
"""The registration error up to which a frame has full weight is that of frames that are refused, over this."""


class TargetResult(NamedTuple):
    """A frame and its target, or why there is none."""

    frame: Frame
    target: Target | None = None
    registration_error: RegistrationError | None = None
    """None if it cannot be measured."""
    weight: float = 1.0
    """Weight of the frame's loss."""
    skip_reason: str = ""


def provide_targets(
    settings: Gtstar,
    capture: Capture,
    face_flags: UInt16[np.ndarray, " f"],
    exaggerated: Caricature,
    shading: Shading | None,
    frames: list[Frame],
    views: TimestepViews | None = None,
    carried_hair: CarriedHair | None = None,
) -> list[TargetResult]:
    """Make the targets of the frames of one timestep.

    The provider `lat` (local affine transformations, section 3.2 of the paper) warps each frame from the tracked mesh
    to the caricature; `gtstar.warp` selects the affine map of equation 5 or the perspective one. `identity` and
    `precomputed` take the frame, or an edited image of the same name, as a picture of the caricature itself, and apply
    the same checks and masks. The images of `command` and `exemplar` are `precomputed` once they are
    made (`carigs.gtstar.by_command`, `carigs.gtstar.by_exemplar`).

    Args:
        settings: Settings of the stage.
        capture: The capture.
        face_flags: Flags of the triangles (`face_mask_flags`).
        exaggerated: The caricature of the head.
        shading: Light for relighting; None keeps the colours of the frame.
        frames: Frames of one timestep.
        views: Their images and the visibility of the tracked mesh, if they have been loaded.
        carried_hair: The hair of the subject, if it is known.

    Returns:
        One result per frame, in order. Frames that cannot be used are skipped with a reason.
    """
    model, parameters = capture.model, capture.parameters(frames[0].timestep)
    warped = settings.provider == "lat"
    caricature_vertices = pose(model, parameters, exaggerated)
    if views is None:
        natural_vertices = pose(model, parameters) if warped else caricature_vertices
        views = load_views(settings, capture, frames, natural_vertices)
    factors = None
    if shading is not None:
        ends, shadow = (views.vertices, caricature_vertices), carried_hair and carried_hair.shadow
        factors = shading.vertex_factors(*(shading.transfer(vertices, model.faces, shadow) for vertices in ends))
    errors = registration_errors(
        {frame: (view.image, view.natural) for frame, view in views.views.items()}, views.vertices, model.faces
    )

    def provide(frame: Frame) -> TargetResult:
        error = errors.get(frame)
        if frame in views.problems:
            return TargetResult(frame, skip_reason=views.problems[frame])
        if error is not None and error.pixels > settings.registration_error_limit:
            reason = f"its colours are {error.pixels:.1f} pixels off those of the other cameras"
            return TargetResult(frame, None, error, skip_reason=reason)
        image, foreground, natural = views.views[frame]
        caricature = compute_visibility(caricature_vertices, model.faces, natural.camera) if warped else natural
        target = make_target(
            image, foreground, natural, caricature, model, face_flags, settings, capture.background, carried_hair
        )
        if not target.front_visible:
            reason = "the camera sees no front of the mesh: behind it or inside"
            return TargetResult(frame, None, error, skip_reason=reason)
        if factors is not None:
            target = replace(target, colour=relight(target.colour, caricature, factors, shading.kept))
        return TargetResult(frame, target, error, frame_weight(error, settings))

    return [provide(frame) for frame in frames]


def frame_weight(error: RegistrationError | None, settings: Gtstar) -> float:
    """Weight of a frame's loss by its registration error.

    Args:
        error: The error; None if it cannot be measured.
        settings: Settings of the stage.

    Returns:
        1 up to a third of `registration_error_limit`, then linearly down to 0 at that limit; 1 for an unknown error.
    """
    limit = settings.registration_error_limit
    tolerance = limit / LIMIT_OVER_TOLERANCE
    return 1.0 if error is None or error.pixels <= tolerance else (limit - error.pixels) / (limit - tolerance)


def check_settings(settings: Gtstar) -> None:
    """Check the settings of the stage before any work.

    Args:
        settings: Settings of the stage.

    Raises:
        SettingsError: For `precomputed` without its folder, for `command` without its program, and for
            `exemplar` without its image.
    """
    if settings.provider == "command":
        find_program(settings.command)
    if settings.provider == "exemplar" and not (settings.exemplar and Path(settings.exemplar).is_file()):
        raise SettingsError(f"gtstar.exemplar={settings.exemplar}: gtstar.provider=exemplar needs an image")
    if settings.provider == "precomputed" and not (settings.folder and Path(settings.folder).is_dir()):
        raise SettingsError(f"gtstar.folder={settings.folder}: gtstar.provider=precomputed needs a folder of images")
