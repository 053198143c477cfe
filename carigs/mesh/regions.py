"""Parts of a surface that have a level of their own: masks, vertex lists and painted scalars as numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float
from scipy.sparse import csc_array, diags_array

from carigs.errors import SettingsError
from carigs.mesh.ambient_occlusion import smoothstep
from carigs.mesh.linear_solver import CholeskySolver

RAMP = 0.04
"""Width of the border over which a region's level fades out, in head sizes."""


SHORT = 3
"""Distances are measured by heat that spreads over this part of the ramp."""


class Regions:
    """The parts of one surface by name, and how far every vertex is from a part."""

    def __init__(
        self, named: Mapping[str, np.ndarray], areas: Float[np.ndarray, " v"], stiffness: csc_array, size: float
    ) -> None:
        """`areas` and `stiffness` are the surface's own; `size` is the head's."""
        self.named, self._areas, self._stiffness, self._size = dict(named), areas, stiffness, size

    def field(self, region: str | np.ndarray | Sequence[int], ramp: bool = True) -> Float[np.ndarray, " v"]:
        """A region as a smooth number in [0, 1] per vertex: 1 inside, fading out over a border around it.

        `region` is a name, a list of vertices, a mask (v,) of booleans, or a painted scalar (v,) in [0, 1], which stays
        as it was painted.
        """
        values = vertex_field(named(self.named, region) if isinstance(region, str) else region, len(self._areas))
        painted = ((values > 0) & (values < 1)).any()
        return values if painted or not ramp else 1 - smoothstep(self.distance(values > 0), 0, RAMP)

    def distance(self, inside: Bool[np.ndarray, " v"]) -> Float[np.ndarray, " v"]:
        """About the distance along the surface from the vertices `inside`, in head sizes, smooth (Varadhan's formula).

        One implicit step of time t spreads heat as exp(-d / sqrt(t)) / 2 beyond a straight border.
        """
        heat = self._spread.solve((self._areas * inside)[:, None])[:, 0]
        return np.where(inside, 0.0, np.maximum(0.0, -RAMP / SHORT * np.log(np.maximum(2 * heat, 1e-300))))

    @cached_property
    def _spread(self) -> CholeskySolver:
        time = (RAMP / SHORT * self._size) ** 2
        return CholeskySolver((diags_array(self._areas) + time * self._stiffness).tocsc())


def vertex_field(region: np.ndarray | Sequence[int], v: int) -> Float[np.ndarray, " v"]:
    """A region as a number in [0, 1] for each of `v` vertices.

    Raises `SettingsError` unless it is a mask of `v` booleans, `v` floating-point numbers in [0, 1], or a list of
    vertices; and for one that holds none.
    """
    region = np.asarray(region)
    if region.size == 0:
        raise SettingsError("a region holds no vertex")
    if region.dtype.kind in "iu" and region.ndim == 1 and region.min() >= 0 and region.max() < v:
        field = np.zeros(v)
        field[region] = 1.0
    elif region.dtype.kind in "bf" and region.shape == (v,) and (region >= 0).all() and (region <= 1).all():
        field = region.astype(np.float64)
    else:
        raise SettingsError(
            f"a region is a list of vertices in 0..{v - 1}, or {v} booleans or numbers in [0, 1]; "
            f"found {region.dtype} of shape {region.shape}"
        )
    if not field.any():
        raise SettingsError("a region holds no vertex")
    return field


def named(regions: Mapping[str, np.ndarray], name: str) -> np.ndarray:
    """The region of a name; `ears` stands for left_ear and right_ear together.

    Raises `SettingsError` that says which there are and where they come from.
    """
    left, right = (f"{side}_{name.removesuffix('s')}" for side in ("left", "right"))
    if name not in regions and name.endswith("s") and left in regions and right in regions:
        join = np.union1d if np.asarray(regions[left]).dtype.kind in "iu" else np.maximum
        return join(regions[left], regions[right])
    if name not in regions:
        known = f"known: {', '.join(sorted(regions))}" if regions else "this mesh came without any"
        raise SettingsError(f"region {name} is unknown; {known} (they come with the head model or a file of regions)")
    return regions[name]


def partition_of_unity(fields: Float[np.ndarray, "r v"]) -> Float[np.ndarray, "r v"]:
    """The fields, scaled down where they overlap to more than 1."""
    return fields / np.maximum(fields.sum(axis=0), 1.0)
