"""Time and gain of relighting GT* targets, over the number of directions of the fitted light."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import product
from time import process_time
from typing import NamedTuple

import numpy as np

from carigs.capture import Capture
from carigs.exaggeration import Caricature, GammaPath
from carigs.gtstar import Target, face_mask_flags, flags_from_names
from carigs.gtstar.capture_shading import fit_capture_shading
from carigs.light import Shading, relight
from carigs.settings import DEFAULT_MASK_FLAGS, Gtstar
from evaluation.benchmarks.measurement.timing import Measurement, median_time
from evaluation.benchmarks.measurement.toy_frames import caricature_scenes, warp_scene
from evaluation.metrics.image_quality import psnr_of_errors, squared_error
from evaluation.metrics.regions import surface_regions

LIGHTS = ("the frame's light", "new light")
REGIONS = ("skin", "face")
DIRECTIONS = (8, 16, 32, 64, 128, 256)
"""Numbers of directions of the fitted light."""


def measure_relighting(subject: Capture, path: GammaPath) -> Iterator[Measurement]:
    """Measure PSNR of trusted pixels of targets before and after relighting, at gamma_f and twice that level.

    Args:
        subject: Capture of the procedural subject.
        path: Its caricature path.

    Yields:
        Records for the regions skin and face; the reference is the value in the light of the frame.
    """
    settings = Gtstar()
    shading = fit_capture_shading(settings, subject, face_mask_flags(subject.model, settings))
    for level in (path.gamma_f, 2 * path.gamma_f):
        values = _psnr_by_light(subject, shading, list(_warped_frames(subject, path.at(level), settings)))
        for (region, light), value in values.items():
            case, reference = f"level {level:g}, {light}", values[region, LIGHTS[0]]
            yield Measurement(case, f"PSNR of trusted {region}", "dB", value, reference)


def measure_light_directions(
    subject: Capture, path: GammaPath, counts: Sequence[int] = DIRECTIONS
) -> Iterator[Measurement]:
    """Measure time and PSNR of relighting at gamma_f over the number of directions of the fitted light.

    Args:
        subject: Capture of the procedural subject.
        path: Its caricature path.
        counts: Numbers of directions.

    Yields:
        CPU times, and PSNR for the regions skin and face; its reference is the value in the light of the frame.
    """
    settings, faces = Gtstar(), subject.model.faces
    face_flags = face_mask_flags(subject.model, settings)
    warped = list(_warped_frames(subject, path.at(path.gamma_f), settings))
    for count in counts:
        case, start = f"{count} light directions", process_time()
        shading = fit_capture_shading(settings, subject, face_flags, num_directions=count)
        fit = process_time() - start
        timestep = median_time(partial(_transfers, shading, warped[0].meshes, faces), 3, process_time)
        yield Measurement(case, "CPU: fit of the light", "s", fit)
        yield Measurement(case, "CPU: transfers of a timestep", "s", timestep)
        values = _psnr_by_light(subject, shading, warped)
        for region in REGIONS:
            before, after = (values[region, light] for light in LIGHTS)
            yield Measurement(case, f"PSNR of trusted {region}", "dB", after, before)


class WarpedFrame(NamedTuple):
    """A test frame warped to its caricature, and the true caricature."""

    target: Target
    meshes: tuple[np.ndarray, np.ndarray]
    """The natural head and the caricature."""
    truth: np.ndarray
    trusted: np.ndarray
    """Pixels of the mesh without any of the default mask flags."""


def _warped_frames(subject: Capture, exaggerated: Caricature, settings: Gtstar) -> Iterator[WarpedFrame]:
    face_flags = face_mask_flags(subject.model, settings)
    excluded = np.uint16(flags_from_names(DEFAULT_MASK_FLAGS).value)
    for *scene, truth, _ in caricature_scenes(subject, subject.split("test")[::2], exaggerated):
        target = warp_scene(subject, face_flags, settings, *scene)
        trusted = (target.caricature.face >= 0) & ((target.mask_flags & excluded) == 0)
        yield WarpedFrame(target, tuple(scene[2:4]), truth, trusted)


def _psnr_by_light(subject: Capture, shading: Shading, warped: Sequence[WarpedFrame]) -> dict[tuple[str, str], float]:
    """PSNR of trusted pixels by region and light."""
    model, squares = subject.model, defaultdict[tuple[str, str], list[np.ndarray]](list)
    regions = surface_regions(model, model.v_template).faces
    for target, meshes, truth, trusted in warped:
        factor = shading.vertex_factors(*(shading.transfer(vertices, model.faces) for vertices in meshes))
        relit = relight(target.colour, target.caricature, factor, shading.kept)
        for region, (light, image) in product(REGIONS, zip(LIGHTS, (target.colour, relit), strict=True)):
            inside = trusted & regions[region][target.caricature.face]
            squares[region, light].append(squared_error(image, truth)[inside])
    return {key: psnr_of_errors(np.concatenate(parts)) for key, parts in squares.items()}


def _transfers(shading: Shading, meshes: tuple[np.ndarray, np.ndarray], faces: np.ndarray) -> list[np.ndarray]:
    return [shading.transfer(vertices, faces) for vertices in meshes]
