"""Where targets come from: the local warp, the frames as they are, or a folder of somebody's own edited frames."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, UInt16

from carigs.capture import Capture, Frame
from carigs.capture.images import read_grey, read_rgb
from carigs.errors import InputError, SettingsError
from carigs.head import pose
from carigs.settings import Gtstar
from carigs.surface import Caricature
from carigs.target.lat import Target, make_target
from carigs.target.light import Shading, fit_light, observe, relight, transfer
from carigs.target.reasons import Reason
from carigs.target.registration import Misfit, misfits
from carigs.target.warp import MAPS

PROVIDERS = ("lat", "identity", "precomputed")
RELIGHTS = ("none", "targets", "targets_and_surfels")
KEPT = Reason.HAIR | Reason.EYEBALLS | Reason.MOUTH
"""Triangles whose colours are no matter of their own normals: strands, gloss, teeth."""
FITTED_TIMESTEPS = 9


class Provided(NamedTuple):
    """A frame and its target, or why there is none."""

    frame: Frame
    target: Target | None
    misfit: Misfit | None
    """How far the frame is off its mesh, where that can be told."""
    left_out: str = ""


def provide(
    settings: Gtstar,
    capture: Capture,
    of_faces: UInt16[np.ndarray, "f"],
    exaggerated: Caricature,
    shading: Shading | None,
) -> Iterator[Provided]:
    """The targets of all training frames, in order, on the mesh that `exaggerated` makes of each.

    With `lat` the frame is warped.  `identity` and `precomputed` take the frame, or a file of its name, for a picture
    of the caricature itself; it goes through the same checks.  A frame that cannot be used is left out, with the
    reason.
    """
    warped = settings.provider == "lat"
    for timestep, frames in groupby(capture.split("train"), key=lambda frame: frame.timestep):
        parameters, faces = capture.parameters(timestep), capture.model.faces
        caricature = pose(capture.model, parameters, exaggerated)
        natural = pose(capture.model, parameters) if warped else caricature
        factor = None
        if shading is not None:
            factor = shading.factor(*(transfer(vertices, faces) for vertices in (natural, caricature)))
        group = list(frames)
        pictures, faults = _pictures(settings, capture, group)
        views = {frame: (image, capture.cameras[frame.camera]) for frame, (image, _) in pictures.items()}
        off = misfits(views, natural, faces)
        for frame in group:
            misfit = off.get(frame)
            if frame not in pictures:
                yield Provided(frame, None, None, faults[frame])
                continue
            if misfit is not None and misfit.pixels > settings.misfit_limit:
                why = f"its colours are {misfit.pixels:.1f} pixels off those of the other cameras"
                yield Provided(frame, None, misfit, why)
                continue
            image, matte = pictures[frame]
            target = make_target(
                image, matte, natural, caricature, capture.cameras[frame.camera], capture.model, of_faces, settings,
                capture.background,
            )  # fmt: skip
            if not target.facing:
                yield Provided(frame, None, misfit, "the camera sees no front of the mesh: behind it or inside")
                continue
            if factor is not None:
                target = replace(target, colour=relight(target.colour, target.caricature, factor, shading.kept))
            yield Provided(frame, target, misfit)


def check_settings(settings: Gtstar) -> None:
    """Raise `SettingsError` for a value without meaning, before any work."""
    for name, choices in (("provider", PROVIDERS), ("relight", RELIGHTS), ("warp", MAPS)):
        if getattr(settings, name) not in choices:
            value = getattr(settings, name)
            raise SettingsError(f"gtstar.{name}={value} is unknown; choose {', '.join(choices[:-1])} or {choices[-1]}")
    for name, low, high in (
        ("supersampling", 1, 8), ("depth_tolerance", 0, 1), ("relight_strength", 0, 1), ("relight_limit", 1, 100),
        ("hair_band", 0, 1000), ("background_ring", 0, 1000), ("grazing", 0, 1), ("stretch", 1, 1e9),
    ):  # fmt: skip
        if not low <= getattr(settings, name) <= high:
            raise SettingsError(f"gtstar.{name}={getattr(settings, name)} must lie in [{low}, {high}]")
    if settings.provider == "precomputed" and not (settings.folder and Path(settings.folder).is_dir()):
        raise SettingsError(f"gtstar.folder={settings.folder}: gtstar.provider=precomputed needs a folder of images")


def fitted_shading(settings: Gtstar, capture: Capture, of_faces: UInt16[np.ndarray, "f"]) -> Shading | None:
    """The light of a capture, from the plain skin of some of its training timesteps; None where nothing is relit."""
    if settings.provider != "lat" or settings.relight == "none":
        return None
    model = capture.model
    skin = np.ones(len(model.v_template), bool)
    skin[model.faces[of_faces > 0]] = False
    frames = capture.split("train")
    timesteps = sorted({frame.timestep for frame in frames})
    chosen = {timesteps[i] for i in np.linspace(0, len(timesteps) - 1, FITTED_TIMESTEPS).astype(int)}
    observations = []
    for timestep in sorted(chosen):
        vertices = pose(model, capture.parameters(timestep))
        pictures, _ = _pictures(settings, capture, [frame for frame in frames if frame.timestep == timestep])
        views = [(image, capture.cameras[frame.camera]) for frame, (image, _) in pictures.items()]
        observations.append(observe(views, vertices, model.faces, skin))
    kept = (of_faces & np.uint16(KEPT.value)) > 0
    return Shading(fit_light(observations), settings.relight_strength, settings.relight_limit, kept)


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
    image, matte = capture.root / frame.image, capture.root / frame.mask
    if settings.provider == "precomputed":
        image = Path(settings.folder) / f"{frame.name}.png"
        edited_matte = image.with_name(f"{frame.name}_mask.png")
        matte = edited_matte if edited_matte.is_file() else matte
    camera = capture.cameras[frame.camera]
    pictures = read_rgb(image), read_grey(matte)
    for pixels, file in zip(pictures, (image, matte), strict=True):
        if pixels.shape[:2] != (camera.height, camera.width):
            size = f"{pixels.shape[1]} x {pixels.shape[0]} pixels"
            raise InputError(f"{size}, its camera has {camera.width} x {camera.height}", file=file)
    return pictures
