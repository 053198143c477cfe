"""Solid noise: reproducible random functions of a point in space."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32

from carigs.simd.kernels import kernel


@kernel
def _hash(x, y, z, seed):
    """32-bit hash of a lattice point."""
    h = (x * 73856093) ^ (y * 19349663) ^ (z * 83492791) ^ (seed * 2654435761)
    h &= 0xFFFFFFFF
    h ^= h >> 16
    h = (h * 0x7FEB352D) & 0xFFFFFFFF
    h ^= h >> 15
    h = (h * 0x846CA68B) & 0xFFFFFFFF
    return h ^ (h >> 16)


@kernel
def _fade(t):
    """Quintic step, with a continuous second derivative."""
    return t * t * t * (t * (t * 6.0 - 15.0) + 10.0)


@kernel
def _gradient_noise(points, scale, octaves, seed):
    out = np.empty(len(points), np.float32)
    for n in range(len(points)):
        total = 0.0
        amplitude = 1.0
        fx, fy, fz = points[n, 0] / scale[0], points[n, 1] / scale[1], points[n, 2] / scale[2]
        for octave in range(octaves):
            ix, iy, iz = int(np.floor(fx)), int(np.floor(fy)), int(np.floor(fz))
            u, v, w = fx - ix, fy - iy, fz - iz
            su, sv, sw = _fade(u), _fade(v), _fade(w)
            value = 0.0
            for c in range(8):
                cx, cy, cz = c & 1, (c >> 1) & 1, c >> 2
                h = _hash(ix + cx, iy + cy, iz + cz, seed + octave)
                gx = (h & 1023) / 511.5 - 1.0
                gy = ((h >> 10) & 1023) / 511.5 - 1.0
                gz = ((h >> 20) & 1023) / 511.5 - 1.0
                weight = (su if cx else 1.0 - su) * (sv if cy else 1.0 - sv) * (sw if cz else 1.0 - sw)
                value += weight * (gx * (u - cx) + gy * (v - cy) + gz * (w - cz))
            total += amplitude * value
            amplitude *= 0.5
            fx, fy, fz = fx * 2.0 + 17.3, fy * 2.0 - 9.1, fz * 2.0 + 4.7
        out[n] = 1.6 * total
    return out


def gradient_noise(
    points: Float32[np.ndarray, "n 3"], scale: float | tuple[float, float, float], octaves: int, seed: int
) -> Float32[np.ndarray, " n"]:
    """Fractal sum of gradient noise (Perlin 2002), each octave with half the wavelength and half the amplitude.

    Args:
        points: Positions, in any unit.
        scale: Wavelength of the first octave in the same unit, one number or one per axis.
        octaves: Number of octaves.
        seed: Selects the random function.

    Returns:
        Values within about [-1, 1].
    """
    return _gradient_noise(points, np.full(3, scale, np.float32), octaves, seed)


@kernel
def spots(points, cell, share, seed):
    """Randomly placed round spots, at most one in each cell of a cubic grid.

    Args:
        points: Positions, (n, 3) float32, in the unit of `cell`.
        cell: Size of the grid's cells.
        share: Share of the cells that have a spot.
        seed: Selects the random function.

    Returns:
        (n,) float32: 1 at the centre of a spot, 0 outside of all spots.
    """
    cell = np.float32(cell)
    out = np.empty(len(points), np.float32)
    for n in range(len(points)):
        fx, fy, fz = points[n, 0] / cell, points[n, 1] / cell, points[n, 2] / cell
        ix, iy, iz = int(np.floor(fx)), int(np.floor(fy)), int(np.floor(fz))
        best = 0.0
        for dx in range(-1, 2):
            for dy in range(-1, 2):
                for dz in range(-1, 2):
                    h = _hash(ix + dx, iy + dy, iz + dz, seed)
                    if (h & 255) >= share * 256.0:
                        continue
                    g = _hash(ix + dx, iy + dy, iz + dz, seed + 7)
                    x = fx - (ix + dx + (g & 1023) / 1023.0)
                    y = fy - (iy + dy + ((g >> 10) & 1023) / 1023.0)
                    z = fz - (iz + dz + ((g >> 20) & 1023) / 1023.0)
                    radius = 0.15 + 0.3 * ((h >> 8) & 255) / 255.0
                    d = np.sqrt(x * x + y * y + z * z) / radius
                    if d < 1.0:
                        best = max(best, (1.0 - d * d) ** 2)
        out[n] = best
    return out
