"""An avatar in one pose, which many cameras can look at."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Float32

from carigs.capture import Camera

if TYPE_CHECKING:
    from carigs.splat.avatar import Avatar
    from carigs.splat.formats.world_splats import WorldSplats
    from carigs.splat.rig.face_motion import FaceMotion


@dataclass(frozen=True)
class PosedHead:
    """An avatar in one pose."""

    avatar: Avatar
    vertices: Float[np.ndarray, "v 3"]
    """World positions of the mesh in metres."""
    motion: FaceMotion
    """Motion of the triangles from the canonical mesh."""
    shade: Float32[np.ndarray, "f 3"] | None
    """Factor on the colours of every triangle; None if colours do not follow the light."""

    def render(self, camera: Camera, *, backend: str = "cpu") -> Float32[np.ndarray, "h w 3"]:
        """Render an image.

        Args:
            camera: The view.
            backend: Rasteriser, see `carigs.splat.rasterizer.rasterize.rasterize`.

        Returns:
            RGB in [0, 1], over the background of the avatar.
        """
        image = self.avatar.render_motion(self.motion, self.shade, camera, backend=backend).image
        return image.numpy().clip(0, 1)

    def surfels(self) -> WorldSplats:
        """The surfels as flat Gaussians in world coordinates.

        Returns:
            Centres, rotations, scales, opacities and colours.
        """
        from carigs.splat.formats.world_splats import bake_motion

        return bake_motion(self.avatar, self.motion, self.shade)
