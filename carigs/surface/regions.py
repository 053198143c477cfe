"""Parts of a surface that have a level of their own: masks, vertex lists and painted scalars as numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from carigs.errors import SettingsError

RAMP = 0.04
"""Width of the border over which a region's level fades out, in head sizes."""


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
