"""Rendered frames against the true images of the same frames, region by region."""

from __future__ import annotations

from collections.abc import Iterator

from rich.progress import track

from carigs.capture import Capture
from carigs.capture.frame_index import GroundTruth, RenderedImage
from carigs.capture.images import read_grey, read_rgb
from carigs.errors import InputError
from carigs.exaggeration import Caricature
from carigs.head import neutral, pose
from carigs.raster import rasterize_mesh
from evaluation.metrics.image_quality import psnr, region_mean, ssim_map
from evaluation.metrics.regions import REGIONS, image_regions, surface_regions
from evaluation.tables.rows import Row, Scene, row

METRICS = ("psnr", "ssim")
PROTOCOLS = ("test", "val")


def compare(
    scene: Scene,
    rendered: list[RenderedImage],
    truths: GroundTruth,
    subject: Capture,
    caricature: Caricature,
    *,
    band: int,
) -> Iterator[Row]:
    """PSNR and SSIM rows of every `test` and `val` frame.

    `caricature` is the one of the scene's level, `band` the silhouette's half width in pixels.
    Where there is no truth at all: one null row per protocol, region and metric.  Raises `InputError` where sizes of
    images differ.
    """
    rendered = [frame for frame in rendered if frame.protocol in PROTOCOLS]
    if truths.reason is not None:
        for protocol in sorted({frame.protocol for frame in rendered}):
            for region in REGIONS:
                for metric in METRICS:
                    yield row(scene, protocol, (None, None), region, metric, None, truths.reason)
        return
    surface = None
    for frame in track(rendered, description="against the truth", disable=len(rendered) < 10):
        here = (frame.camera, frame.timestep)
        key = (frame.timestep, frame.camera)
        if key not in truths.images:
            for metric in METRICS:
                yield row(scene, frame.protocol, here, "full", metric, None, "no true image of this frame")
            continue
        image, truth = read_rgb(frame.file), read_rgb(truths.images[key])
        foreground = read_grey(truths.masks[key]) > 0.5
        camera = subject.cameras[frame.camera]
        for array, file in ((image, frame.file), (truth, truths.images[key]), (foreground, truths.masks[key])):
            if array.shape[:2] != (camera.height, camera.width):
                size = f"{array.shape[1]} x {array.shape[0]} pixels"
                raise InputError(f"{size}, its camera has {camera.width} x {camera.height}", file=file)
        parameters = subject.parameters(frame.timestep)
        if surface is None:
            surface = surface_regions(subject.model, neutral(subject.model, parameters))
        vertices = pose(subject.model, parameters, caricature)
        fragments = rasterize_mesh(vertices, subject.model.faces, camera)
        regions = image_regions(surface, vertices, fragments, camera, foreground, band=band)
        similarity = ssim_map(image, truth)
        for region in REGIONS:
            inside = regions.get(region)
            if inside is None or not inside.any():
                reason = surface.missing[region] if inside is None else "no pixel of this region in view"
                for metric in METRICS:
                    yield row(scene, frame.protocol, here, region, metric, None, reason)
                continue
            yield row(scene, frame.protocol, here, region, "psnr", psnr(image, truth, inside))
            yield row(scene, frame.protocol, here, region, "ssim", region_mean(similarity, inside))
