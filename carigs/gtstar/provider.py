"""Where targets come from: the local warp, the frames as they are, or a folder of somebody's own edited frames."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, UInt16

from carigs.capture import Capture, Frame
from carigs.capture.images import read_grey, read_rgb
from carigs.errors import InputError, SettingsError
from carigs.exaggeration import Caricature
from carigs.gtstar.mask_flags import MaskFlag
from carigs.gtstar.registration import RegistrationError, registration_errors
from carigs.gtstar.target import Target, make_target
from carigs.head import pose
from carigs.light.fitting import Observation, Shading, fit_light, observe, relight
from carigs.settings import Gtstar

KEPT = MaskFlag.HAIR | MaskFlag.EYEBALLS | MaskFlag.MOUTH
"""Triangles whose colours are no matter of their own normals: strands, gloss, teeth."""
FITTED_TIMESTEPS = 9


class Provided(NamedTuple):
    """A frame and its target, or why there is none."""

    frame: Frame
    target: Target | None
    misfit: RegistrationError | None
    """How far the frame is off its mesh, where that can be told."""
    weight: float = 1.0
    """What the frame counts for: less where it is off its mesh."""
    left_out: str = ""


def provide(
    settings: Gtstar,
    capture: Capture,
    of_faces: UInt16[np.ndarray, "f"],
    exaggerated: Caricature,
    shading: Shading | None,
    frames: list[Frame],
) -> list[Provided]:
    """The targets of the frames of one timestep, in order, on the mesh that `exaggerated` makes of it.

    With `lat` the frame is warped.  `identity` and `precomputed` take the frame, or a file of its name, for a picture
    of the caricature itself; it goes through the same checks.  A frame that cannot be used is left out, with the
    reason.
    """
    parameters, faces = capture.parameters(frames[0].timestep), capture.model.faces
    caricature = pose(capture.model, parameters, exaggerated)
    natural = pose(capture.model, parameters) if settings.provider == "lat" else caricature
    factor = None
    if shading is not None:
        factor = shading.factor(*(shading.transfer(vertices, faces) for vertices in (natural, caricature)))
    pictures, faults = _pictures(settings, capture, frames)
    views = {frame: (image, capture.cameras[frame.camera]) for frame, (image, _) in pictures.items()}
    off = registration_errors(views, natural, faces)
    provided = []
    for frame in frames:
        misfit = off.get(frame)
        if frame not in pictures:
            provided.append(Provided(frame, None, None, left_out=faults[frame]))
            continue
        if misfit is not None and misfit.pixels > settings.registration_error_limit:
            why = f"its colours are {misfit.pixels:.1f} pixels off those of the other cameras"
            provided.append(Provided(frame, None, misfit, left_out=why))
            continue
        image, matte = pictures[frame]
        target = make_target(
            image, matte, natural, caricature, capture.cameras[frame.camera], capture.model, of_faces, settings,
            capture.background,
        )  # fmt: skip
        if not target.facing:
            why = "the camera sees no front of the mesh: behind it or inside"
            provided.append(Provided(frame, None, misfit, left_out=why))
            continue
        if factor is not None:
            target = replace(target, colour=relight(target.colour, target.caricature, factor, shading.kept))
        provided.append(Provided(frame, target, misfit, frame_weight(misfit, settings)))
    return provided


def frame_weight(misfit: RegistrationError | None, settings: Gtstar) -> float:
    """1 up to `registration_error_tolerance` pixels, then falling to 0 at `registration_error_limit`; 1 if unknown."""
    if misfit is None or misfit.pixels <= settings.registration_error_tolerance:
        return 1.0
    return (settings.registration_error_limit - misfit.pixels) / (
        settings.registration_error_limit - settings.registration_error_tolerance
    )


def input_files(settings: Gtstar, capture: Capture) -> list[Path]:
    """Every file that the targets depend on, beside the index of the capture and the path."""
    files = [capture.head_model]
    for frame in capture.split("train"):
        files += [capture.root / frame.parameters, *_files(settings, capture, frame)]
    return list(dict.fromkeys(files))


def check_settings(settings: Gtstar) -> None:
    """Raise `SettingsError` for a folder that does not exist."""
    if settings.provider == "precomputed" and not Path(settings.folder).is_dir():
        raise SettingsError(f"gtstar.folder={settings.folder}: gtstar.provider=precomputed needs a folder of images")


def fitted_shading(
    settings: Gtstar, capture: Capture, of_faces: UInt16[np.ndarray, "f"], run: Callable = map
) -> Shading | None:
    """The light of a capture, from the plain skin of some of its training timesteps; None where nothing is relit.

    `run` is `map`, or that of an executor.
    """
    if settings.provider != "lat" or settings.relight == "none":
        return None
    model = capture.model
    skin = np.ones(len(model.v_template), bool)
    skin[model.faces[of_faces > 0]] = False
    frames = capture.split("train")
    timesteps = sorted({frame.timestep for frame in frames})
    chosen = {timesteps[i] for i in np.linspace(0, len(timesteps) - 1, FITTED_TIMESTEPS).astype(int)}

    def observed(timestep: int) -> Observation:
        vertices = pose(model, capture.parameters(timestep))
        pictures, _ = _pictures(settings, capture, [frame for frame in frames if frame.timestep == timestep])
        views = [(image, capture.cameras[frame.camera]) for frame, (image, _) in pictures.items()]
        return observe(views, vertices, model.faces, skin)

    observations = list(run(observed, sorted(chosen)))
    kept = (of_faces & np.uint16(KEPT.value)) > 0
    directions, light = fit_light(observations, model.faces, run)
    return Shading(directions, light, settings.relight_strength, settings.relight_limit, kept)


def _pictures(
    settings: Gtstar, capture: Capture, frames: list[Frame]
) -> tuple[dict[Frame, tuple[np.ndarray, np.ndarray]], dict[Frame, str]]:
    """Image and matte of each frame, or what is wrong with them."""
    pictures, faults = {}, {}
    for frame in frames:
        try:
            pictures[frame] = _picture(settings, capture, frame)
        except InputError as error:
            faults[frame] = str(error)
    return pictures, faults


def _picture(
    settings: Gtstar, capture: Capture, frame: Frame
) -> tuple[Float32[np.ndarray, "h w 3"], Float32[np.ndarray, "h w"]]:
    """Image and matte of a frame, or of its edited copy; raises `InputError` for one that cannot be used."""
    image, matte = _files(settings, capture, frame)
    camera = capture.cameras[frame.camera]
    pictures = read_rgb(image), read_grey(matte)
    for pixels, file in zip(pictures, (image, matte), strict=True):
        if pixels.shape[:2] != (camera.height, camera.width):
            size = f"{pixels.shape[1]} x {pixels.shape[0]} pixels"
            raise InputError(f"{size}, its camera has {camera.width} x {camera.height}", file=file)
    return pictures


def _files(settings: Gtstar, capture: Capture, frame: Frame) -> tuple[Path, Path]:
    image, matte = capture.root / frame.image, capture.root / frame.mask
    if settings.provider == "precomputed":
        image = Path(settings.folder) / f"{frame.name}.png"
        edited_matte = image.with_name(f"{frame.name}_mask.png")
        matte = edited_matte if edited_matte.is_file() else matte
    return image, matte
