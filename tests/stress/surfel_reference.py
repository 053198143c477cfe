"""Independent reference of the surfel rasterizer in float64 torch: dense, surfel by surfel, gradients by autograd.

It follows the absolute-pixel form of 2D Gaussian Splatting and gsplat, in which a pixel's ray is the intersection of
two planes. It shares no formula with the kernels.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch

from carigs.capture import Camera


def render(
    surfels: Sequence[torch.Tensor], camera: Camera, *, alpha_cap: float = 0.99, near: float = 0.01
) -> dict[str, torch.Tensor]:
    """Render surfels over black.

    Args:
        surfels: centre, tangent_u, tangent_v, opacity, colour (`carigs.splat.rasterizer.interface.WorldSurfels`) as
            float64 tensors.
        camera: The camera.
        alpha_cap: Upper limit of a surfel's alpha.
        near: Depth in metres up to which surfels are not drawn.

    Returns:
        The images colour, alpha, depth, normal, distortion (h, w[, 3]), and `margin` (h, w): the smallest relative
        distance of any quantity of the pixel from its threshold; where it is tiny, float32 may fall on the other side.
    """
    centre, tangent_u, tangent_v, opacity, colour = surfels
    view = torch.as_tensor(camera.camera_from_world, dtype=torch.float64)
    rotation, offset = view[:3, :3], view[:3, 3]
    intrinsics = torch.tensor([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]], dtype=torch.float64)
    h, w = camera.height, camera.width
    y, x = torch.meshgrid(torch.arange(h).double() + 0.5, torch.arange(w).double() + 0.5, indexing="ij")

    mean = centre @ rotation.T + offset
    u, v = tangent_u @ rotation.T, tangent_v @ rotation.T
    normal = torch.linalg.cross(u, v)
    drawn = (mean[:, 2] > near) & (opacity >= 1 / 255) & (torch.linalg.cross(tangent_u, tangent_v).norm(dim=1) > 1e-24)
    drawn &= torch.stack([t.reshape(len(t), -1).isfinite().all(1) for t in surfels]).all(0)
    # The visible ellipse must stay in front of the camera plane.
    squared = (u[:, 2] / mean[:, 2]) ** 2 + (v[:, 2] / mean[:, 2]) ** 2
    drawn &= 2 * torch.log(255 * opacity) * squared - 1 < -1e-4
    index = torch.nonzero(drawn)[:, 0]
    index = index[torch.argsort(mean[index, 2].float(), stable=True)]

    transmittance = torch.ones(h, w, dtype=torch.float64)
    ended = torch.zeros(h, w, dtype=torch.bool)
    margin = torch.ones(h, w, dtype=torch.float64)
    image = {name: torch.zeros(h, w, dtype=torch.float64) for name in ("alpha", "depth", "distortion")}
    image |= {name: torch.zeros(h, w, 3, dtype=torch.float64) for name in ("colour", "normal")}
    for i in index.tolist():
        # Rows: pixel-space homogeneous x, y, w as linear functions of (s, t, 1).
        rows = intrinsics @ torch.stack([u[i], v[i], mean[i]], dim=1)
        # The two planes through the pixel, pulled back to (s, t, 1); they meet in zeta.
        plane_x = x[..., None] * rows[2] - rows[0]
        plane_y = y[..., None] * rows[2] - rows[1]
        zeta = torch.linalg.cross(plane_x, plane_y)
        hit = zeta[..., 2] != 0
        g = torch.where(hit, (zeta[..., :2] ** 2).sum(-1) / torch.where(hit, zeta[..., 2], 1.0) ** 2, torch.inf)
        raw = opacity[i] * torch.exp(-g / 2)
        alpha = raw.clamp(max=alpha_cap)
        after = transmittance * (1 - alpha)
        valid = (raw >= 1 / 255) & ~ended
        ends = valid & (after <= 1e-4)
        with torch.no_grad():
            for value, threshold in ((raw, 1 / 255), (raw, alpha_cap)):
                margin = torch.where(ended, margin, torch.minimum(margin, (value / threshold - 1).abs()))
            margin = torch.where(valid, torch.minimum(margin, (after / 1e-4 - 1).abs()), margin)
        weight = torch.where(valid & ~ends, transmittance * alpha, 0.0)
        facing = normal[i] / normal[i].norm()
        facing = -facing if facing @ mean[i] > 0 else facing
        z = mean[i, 2]
        front_alpha, front_depth = image["alpha"], image["depth"]
        image["distortion"] = image["distortion"] + 2 * weight * (z * front_alpha - front_depth)
        image["alpha"] = front_alpha + weight
        image["depth"] = front_depth + weight * z
        image["colour"] = image["colour"] + weight[..., None] * colour[i]
        image["normal"] = image["normal"] + weight[..., None] * facing
        transmittance = torch.where(valid & ~ends, after, transmittance)
        ended = ended | ends
    image["margin"] = margin
    return image
