"""The kernel of light transport (Numba): which vertices a direction's light reaches, by a shadow map."""

from __future__ import annotations

import numba

kernel = numba.njit(cache=True, error_model="numpy", nogil=True)


@kernel
def add_lit(transfer, column, points, pixel, cosine, nearness, tolerance):
    """Write the cosine times the share of the four shadow-map pixels around each vertex that do not hide it.

    `points` are in the lamp's camera axes; what is more than `tolerance` metres behind the map is in shadow.
    """
    side = nearness.shape[0]
    for i in range(points.shape[0]):
        transfer[i, column] = 0.0
        if cosine[i] <= 0.0:
            continue
        x, y = min(max(pixel[i, 0] - 0.5, 0.0), side - 1.001), min(max(pixel[i, 1] - 0.5, 0.0), side - 1.001)
        x0, y0 = int(x), int(y)
        lit = 0.0
        for j in range(2):
            for k in range(2):
                near = nearness[y0 + j, x0 + k]
                if near * (points[i, 2] - tolerance) < 1.0:  # nothing is at an inverse depth of 0
                    lit += (x - x0 if k else 1.0 - x + x0) * (y - y0 if j else 1.0 - y + y0)
        transfer[i, column] = cosine[i] * lit
