"""Metrics of the avatar's geometry, which exists only while the avatar is rendered: adherence, holes, gain."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from math import isnan

import numpy as np
import torch

from carigs.capture import Camera, Capture
from carigs.exaggeration import GammaPath
from carigs.head import neutral
from carigs.raster import Visibility
from carigs.splat.avatar import Avatar
from carigs.splat.rasterizer.rasterize import FIELDS, WorldSurfels, rasterize
from evaluation.metrics.exaggeration_gain import SurfaceAnchors, exaggeration_gain, find_anchors
from evaluation.metrics.frame_views import PosedMesh
from evaluation.metrics.mesh_adherence import RenderedSurface, mesh_adherence, not_hidden
from evaluation.metrics.regions import MESH_REGIONS, SurfaceRegions, mesh_regions, surface_regions
from evaluation.tables.frame_records import FrameRecord

ADHERENCE = ("depth_error", "normal_error", "silhouette_iou", "hole_rate")


class AvatarGeometry:
    """Measures rendered frames of an avatar against the mesh of the capture at the same level."""

    def __init__(self, subject: Capture, avatar: Avatar, path: GammaPath, level: float, backend: str = "cpu") -> None:
        """Prepare the measurement.

        Args:
            subject: The capture.
            avatar: The avatar.
            path: Caricature path of the subject.
            level: Exaggeration level of the frames.
            backend: Rasteriser, see `carigs.splat.rasterizer.rasterize.rasterize`.
        """
        self._subject, self._avatar, self._level, self._backend = subject, avatar, level, backend
        self._caricature = path.at(level)
        self._head: PosedMesh | None = None
        self._anchors: SurfaceAnchors | None = None
        self._timesteps_with_gain: set[int] = set()

    def records(self, timestep: int, number: int, camera: Camera, world: WorldSurfels) -> Iterator[FrameRecord]:
        """Measure a frame of the protocol `test` and, once per timestep above level 0, the gain.

        Args:
            timestep: Timestep of the frame.
            number: Number of its camera.
            camera: The camera.
            world: The avatar's surfels in world coordinates.

        Yields:
            One record per region and metric.
        """
        if self._head is None or self._head.timestep != timestep:
            self._head = PosedMesh(self._subject, timestep, self._caricature)
        if self._level > 0 and timestep not in self._timesteps_with_gain:
            self._timesteps_with_gain.add(timestep)
            yield from self._gains(timestep, world.centre.double().numpy())
        visibility = self._head.seen_by(camera)
        regions = mesh_regions(self._surface, visibility.face)
        values = mesh_adherence(self._rendered_surface(world, visibility), visibility, regions)
        for region in MESH_REGIONS:
            for metric in ADHERENCE:
                value = values.get((region, metric))
                yield self._record(
                    ("test", number, timestep, region, metric), value, "no opaque pixel of this region in view"
                )

    def _rendered_surface(self, world: WorldSurfels, visibility: Visibility) -> RenderedSurface:
        """Rasterise the surfels that the mesh does not hide."""
        kept = torch.from_numpy(not_hidden(world.centre.numpy(), visibility))
        surfels = WorldSurfels(*(getattr(world, name)[kept] for name in FIELDS))
        outputs = RenderedSurface._fields
        images = rasterize(surfels, visibility.camera, backend=self._backend, outputs=outputs)
        return RenderedSurface(*(getattr(images, name).numpy() for name in outputs))

    def _gains(self, timestep: int, exaggerated: np.ndarray) -> Iterator[FrameRecord]:
        natural = self._avatar.skinned(timestep, 0.0)
        centres = natural.centre.double().numpy()
        if self._anchors is None:
            self._anchors = find_anchors(centres, self._head.natural, self._subject.model.faces)
        anchors = self._anchors
        u, v, opacity = (array.double().numpy()[anchors.surfels] for array in natural[1:4])
        weights = opacity * np.linalg.norm(np.cross(u, v), axis=1)
        measured = (exaggerated - centres)[anchors.surfels]
        intended = anchors.displacements(self._head.vertices - self._head.natural)
        faces = {"full": np.ones(len(self._subject.model.faces), bool), **self._surface.faces}
        for region in MESH_REGIONS:
            value = None
            if region in faces:
                inside = faces[region][anchors.face]
                value = exaggeration_gain(measured[inside], intended[inside], weights[inside])
            yield self._record(("test", None, timestep, region, "exaggeration_gain"), value, "no surfel is to move")

    def _record(self, key: tuple, value: float | None, reason: str) -> FrameRecord:
        """Record of a value; None stands for a region that the head model does not define, nan for `reason`."""
        if value is None:
            return FrameRecord(*key, None, self._surface.missing[key[3]])
        return FrameRecord(*key, None, reason) if isnan(value) else FrameRecord(*key, value, "")

    @cached_property
    def _surface(self) -> SurfaceRegions:
        parameters = self._subject.parameters(self._head.timestep)
        return surface_regions(self._subject.model, neutral(self._subject.model, parameters))
