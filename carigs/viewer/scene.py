"""Surfels of an avatar for values of the controls, fast while one slider moves.

With a given expression and pose, the posed mesh is affine in the displacement of the neutral head
(`carigs.head.posing.posed_changes`). So the changes of the posed mesh at the nodes of the paths are computed once for a
pose, and a level costs a product of a few weights with a small matrix. Shading is slow: it follows when nothing moves.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import TypeVar

import numpy as np
import torch
from jaxtyping import Float, Float32

from carigs.exaggeration import Caricature, GammaPath
from carigs.head import pose, posed_changes
from carigs.library import HeadAvatar, PosedHead
from carigs.splat.colour.appearance import seen_colour
from carigs.splat.rasterizer.interface import WorldSurfels
from carigs.splat.render import skin
from carigs.splat.rig.face_motion import FaceMotion
from carigs.viewer.drives import Drive
from carigs.viewer.state import Values, is_level, parameters_of, region_levels

POSES, MOTIONS, SHADES = 8, 8, 64
"""Poses, motions and shadings that are kept."""
T = TypeVar("T")


class _Pose:
    """The posed natural head, and its changes at the nodes of the paths that were asked for."""

    def __init__(
        self, avatar: HeadAvatar, region_path: Callable[[str], GammaPath], values: Values, drives: tuple[Drive, ...]
    ) -> None:
        self._avatar, self._head, self._region_path = avatar, avatar.avatar.sequence.head, region_path
        self._parameters = parameters_of(avatar, values, drives)
        self._natural = pose(self._head, self._parameters)
        self._changes: dict[str, Float32[np.ndarray, "j w"]] = {}

    def vertices(self, level: float, regions: dict[str, float]) -> Float[np.ndarray, "v 3"]:
        """The posed mesh at a level of the head and levels of regions."""
        vertices = self._natural
        for name, value in {"": level, **regions}.items():
            if value:
                path = self._region_path(name) if name else self._avatar.avatar.sequence.path
                weights = path.weights(value)[1:].astype(np.float32)
                vertices = vertices + (weights @ self._changes_of(name, path)).reshape(-1, 3)
        return vertices

    def _changes_of(self, name: str, path: GammaPath) -> Float32[np.ndarray, "j w"]:
        if name not in self._changes:
            displacements = path.displacements[1:]
            changes = [None] * len(displacements) if path.changes is None else path.changes
            nodes = [Caricature(d, path.columns, c) for d, c in zip(displacements, changes, strict=True)]
            moved = posed_changes(self._head, self._parameters, nodes)
            self._changes[name] = moved.reshape(len(nodes), -1).astype(np.float32)
        return self._changes[name]


class HeadScene:
    """An avatar as the viewer shows it. One thread at a time may use it.

    Attributes:
        avatar: The avatar.
        drives: Motions that it can show.
    """

    def __init__(self, avatar: HeadAvatar, drives: tuple[Drive, ...] = ()) -> None:
        """Take an avatar.

        Args:
            avatar: The avatar.
            drives: Motions that it can show.
        """
        self.avatar, self.drives = avatar, drives
        self._solving = threading.Lock()
        self._poses: OrderedDict[Hashable, _Pose] = OrderedDict()
        self._motions: OrderedDict[Hashable, tuple[Float[np.ndarray, "v 3"], FaceMotion]] = OrderedDict()
        self._shades: OrderedDict[Hashable, Float32[np.ndarray, "f 3"]] = OrderedDict()

    def vertices(self, values: Values) -> Float[np.ndarray, "v 3"]:
        """The posed mesh.

        Args:
            values: Values of the controls.

        Returns:
            World vertices in metres.
        """
        return self._posed(values)[0]

    def motion(self, values: Values) -> FaceMotion:
        """Motion of the triangles from the canonical mesh.

        Args:
            values: Values of the controls.

        Returns:
            The motion.
        """
        return self._posed(values)[1]

    def shade(self, values: Values, *, settled: bool = True) -> Float32[np.ndarray, "f 3"] | None:
        """Factor on the colours of every triangle.

        Args:
            values: Values of the controls.
            settled: Whether to compute it. If not, the last one that was computed is taken: shading lags behind while
                something moves.

        Returns:
            The factors, or None if colours do not follow the light or nothing was computed before.
        """
        sequence = self.avatar.avatar.sequence
        if sequence.shading is None:
            return None
        key = _key(values)
        if settled or not self._shades:
            return _cached(self._shades, SHADES, key, lambda: sequence.shade_of(self.vertices(values)))
        return self._shades[key] if key in self._shades else next(reversed(self._shades.values()))

    def surfels(
        self,
        values: Values,
        eye: Float[np.ndarray, "3"],
        *,
        settled: bool = True,
        face_colours: Float32[np.ndarray, "f 3"] | None = None,
        cover: float = 0.75,
    ) -> WorldSurfels:
        """Surfels in world coordinates with the colours that a camera sees, as `HeadAvatar.render` renders them.

        Args:
            values: Values of the controls.
            eye: Centre of the camera in world coordinates.
            settled: Whether the shading must be that of these values, see `shade`.
            face_colours: Colours of an overlay.
            cover: Opacity of the overlay.

        Returns:
            The surfels.
        """
        avatar = self.avatar.avatar
        surfels = avatar.surfels
        with torch.no_grad():
            skinned = skin(
                surfels, avatar.sequence.rig, self.motion(values), skinning=avatar.skinning,
                eye=eye if surfels.sh_degree > 0 else None, rotate_harmonics=avatar.rotate_harmonics,
            )  # fmt: skip
            shade = self.shade(values, settled=settled)
            colour = seen_colour(surfels.colour, surfels.harmonics, skinned.direction, shade, surfels.binding)
            if face_colours is not None:
                colour = (1 - cover) * colour + cover * torch.from_numpy(face_colours[surfels.binding])
        return WorldSurfels(*skinned[:4], colour)

    def solve_region(self, name: str) -> GammaPath:
        """Path of a region; any thread may call this.

        Args:
            name: One of `HeadAvatar.regions`.

        Returns:
            The path. The first call for a region solves.
        """
        with self._solving:
            return self.avatar.region_path(name)

    def posed_head(self, values: Values) -> PosedHead:
        """The head as the library poses it.

        Args:
            values: Values of the controls.

        Returns:
            The posed head.
        """
        return PosedHead(self.avatar.avatar, self.vertices(values), self.motion(values), self.shade(values))

    def _posed(self, values: Values) -> tuple[Float[np.ndarray, "v 3"], FaceMotion]:
        def compute() -> tuple[Float[np.ndarray, "v 3"], FaceMotion]:
            key = _key({name: value for name, value in values.items() if not is_level(name)})
            posed = _cached(self._poses, POSES, key, lambda: _Pose(self.avatar, self.solve_region, values, self.drives))
            regions = {name: v for name, v in region_levels(values).items() if name in self.avatar.regions}
            vertices = posed.vertices(values["level"], regions)
            return vertices, self.avatar.avatar.sequence.motion_of(vertices)

        return _cached(self._motions, MOTIONS, _key(values), compute)


def _key(values: Values) -> Hashable:
    return tuple(sorted((name, value) for name, value in values.items() if value))


def _cached(cache: OrderedDict[Hashable, T], size: int, key: Hashable, compute: Callable[[], T]) -> T:
    """An entry of a cache of the entries that were used last."""
    if key not in cache:
        cache[key] = compute()
        while len(cache) > size:
            cache.popitem(last=False)
    cache.move_to_end(key)
    return cache[key]
