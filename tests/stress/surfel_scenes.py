"""Scenes of surfels that break numerics: each kind is a change of a regular surfel."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float32

from carigs.capture import Camera
from carigs.splat.rasterizer.rasterize import FIELDS
from carigs.splat.rasterizer.records import NEAR_PLANE

# The camera has neither rotation nor offset, so that the depth of a surfel is exactly its z.
CAMERA = Camera(np.eye(4), fx=60, fy=58, cx=16.3, cy=13.8, width=33, height=27)
Surfel = dict[str, np.ndarray | float]


def scene(kinds: Sequence[str], seed: int) -> list[Float32[np.ndarray, "..."]]:
    """Surfels in front of `CAMERA`.

    Args:
        kinds: Kind of each surfel, of `KINDS` or `regular`.
        seed: Seed of their places, sizes, opacities and colours.

    Returns:
        Arrays of the fields of `WorldSurfels`, in the order of `FIELDS`.
    """
    random, surfels = np.random.default_rng(seed), []
    for kind in kinds:
        surfels.append(_regular(random))
        if kind != "regular":
            KINDS[kind](surfels[-1], random)
    shapes = {name: (-1,) if name == "opacity" else (-1, 3) for name in FIELDS}
    return [np.array([surfel[name] for surfel in surfels], np.float32).reshape(shapes[name]) for name in FIELDS]


def _regular(random: np.random.Generator) -> Surfel:
    """A skewed disc in view, at 1 to 3 m."""
    axes = np.linalg.qr(random.normal(size=(3, 3)))[0][:2] * 0.08 * np.exp(random.normal(0, 0.6, (2, 1)))
    return {
        "centre": np.append(random.uniform(-0.25, 0.25, 2), 1) * random.uniform(1, 3),
        "tangent_u": axes[0],
        "tangent_v": axes[1] + 0.4 * random.normal() * axes[0],
        "opacity": random.uniform(0.02, 1),
        "colour": random.random(3),
    }


def _resize(surfel: Surfel, u: float, v: float) -> None:
    surfel["tangent_u"], surfel["tangent_v"] = u * surfel["tangent_u"], v * surfel["tangent_v"]


def _move(surfel: Surfel, z: float) -> None:
    """Move a surfel to another depth and scale it, so that its image stays the same."""
    factor = abs(z) / surfel["centre"][2]
    _resize(surfel, factor, factor)
    surfel["centre"] = np.append(surfel["centre"][:2] * factor, z)


def _tiny(surfel: Surfel, random: np.random.Generator) -> None:
    factor = 10 ** random.uniform(-11, 0)
    _resize(surfel, factor, factor)


def _needle(surfel: Surfel, random: np.random.Generator) -> None:
    _resize(surfel, 10 ** random.uniform(-11, 0), 1)


def _huge(surfel: Surfel, random: np.random.Generator) -> None:
    """Up to 1000 m and nearly parallel to the image; never opaque: gradients behind closed layers are not exact."""
    _resize(surfel, *10 ** random.uniform(1, 4, 2))
    surfel["tangent_u"][2], surfel["tangent_v"][2] = random.normal(0, 0.2, 2)
    surfel["opacity"] = random.uniform(0.02, 0.3)


def _crossing(surfel: Surfel, random: np.random.Generator) -> None:
    """The disc reaches behind the camera, or covers a large part of the image."""
    _resize(surfel, *10 ** random.uniform(0, 4, 2))


def _edge_on(surfel: Surfel, random: np.random.Generator) -> None:
    ray = surfel["centre"] / np.linalg.norm(surfel["centre"])
    side = np.cross(ray, random.normal(size=3))
    side /= np.linalg.norm(side)
    lifted = ray + 10 ** random.uniform(-9, -1) * np.cross(ray, side)
    surfel["tangent_u"] = np.linalg.norm(surfel["tangent_u"]) * side
    surfel["tangent_v"] = np.linalg.norm(surfel["tangent_v"]) * lifted


def _close(surfel: Surfel, random: np.random.Generator) -> None:
    _move(surfel, 10 ** random.uniform(-2.2, 0))


def _at_near_plane(surfel: Surfel, random: np.random.Generator) -> None:
    plane = np.float32(NEAR_PLANE)
    _move(surfel, random.choice([plane, np.nextafter(plane, np.float32(1)), np.nextafter(plane, np.float32(0))]))


def _at_camera(surfel: Surfel, random: np.random.Generator) -> None:
    surfel["centre"] = surfel["centre"] * random.choice([0, 1e-38, -1e-38, 1e-6])


def _behind(surfel: Surfel, random: np.random.Generator) -> None:
    _move(surfel, -(10 ** random.uniform(-3, 3)))


def _far(surfel: Surfel, random: np.random.Generator) -> None:
    _move(surfel, 10 ** random.uniform(0.5, 3))


def _without_area(surfel: Surfel, random: np.random.Generator) -> None:
    _resize(surfel, random.choice([0.0, 1.0]), 1)
    surfel["tangent_v"] = random.choice([0.0, -2.0, 1e-3]) * surfel["tangent_u"]


def _special_opacity(surfel: Surfel, random: np.random.Generator) -> None:
    surfel["opacity"] = random.choice([0.0, 1e-30, 1 / 255, 0.0045, 0.99, 0.9901, 1.0])


def _at_equal_depth(surfel: Surfel, random: np.random.Generator) -> None:
    _move(surfel, 2.0)


THICK: dict[str, Callable[[Surfel, np.random.Generator], None]] = {
    "tiny": _tiny,
    "huge": _huge,
    "crossing": _crossing,
    "close": _close,
    "at_near_plane": _at_near_plane,
    "at_camera": _at_camera,
    "behind": _behind,
    "far": _far,
    "without_area": _without_area,
    "special_opacity": _special_opacity,
    "at_equal_depth": _at_equal_depth,
}
THIN = {"needle": _needle, "edge_on": _edge_on}
"""Kinds whose images may be thinner than the float32 spacing of pixel positions."""
KINDS = {**THICK, **THIN}
