"""Regions of a surface: vertex lists, masks and painted scalars as smooth fields on the vertices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float
from scipy.sparse import csc_array, diags_array

from carigs.errors import SettingsError
from carigs.mesh.linear_solver import CholeskySolver
from carigs.mesh.smoothstep import smoothstep

RAMP = 0.04
"""Width of the border over which a region's field falls from 1 to 0, in head sizes."""
DIFFUSION_LENGTH = RAMP / 3
"""sqrt(t) of the heat step that distances are computed from, in head sizes."""


class Regions:
    """Named regions of one surface as smooth fields, and distances along the surface."""

    def __init__(
        self, named: Mapping[str, np.ndarray], areas: Float[np.ndarray, " v"], stiffness: csc_array, size: float
    ) -> None:
        """Keep the regions of a surface.

        Args:
            named: Regions by name, each in one of the forms that `vertex_field` takes.
            areas: Mixed Voronoi areas of the surface.
            stiffness: Cotan stiffness of the surface (v, v).
            size: Size of the head, in the unit of the vertices.
        """
        self.named, self._areas, self._stiffness, self._size = dict(named), areas, stiffness, size

    def field(self, region: str | np.ndarray | Sequence[int], ramp: bool = True) -> Float[np.ndarray, " v"]:
        """Smooth field of a region: 1 inside, falling to 0 over a border of width `RAMP` around it.

        Args:
            region: A name, vertex indices, a boolean mask (v,), or a painted scalar (v,) in [0, 1]; the latter is
                returned as it is.
            ramp: Whether to add the border.

        Returns:
            Values in [0, 1].

        Raises:
            SettingsError: If the region is unknown or not valid.
        """
        selected = find_region(self.named, region) if isinstance(region, str) else region
        values = vertex_field(selected, len(self._areas), region_label(region))
        is_painted = ((values > 0) & (values < 1)).any()
        return values if is_painted or not ramp else 1 - smoothstep(self.distance(values > 0), 0, RAMP)

    def distance(self, inside: Bool[np.ndarray, " v"]) -> Float[np.ndarray, " v"]:
        """Approximate geodesic distance from a set of vertices, smooth.

        One implicit heat step of time t spreads heat as h = exp(-d / sqrt(t)) / 2 beyond a straight border, hence
        d = -sqrt(t) ln(2 h) (Varadhan 1967; Crane et al. 2013).

        Args:
            inside: The vertices with distance 0.

        Returns:
            Distances in head sizes.
        """
        heat = self._heat_step.solve((self._areas * inside)[:, None])[:, 0]
        return np.where(inside, 0.0, np.maximum(0.0, -DIFFUSION_LENGTH * np.log(np.maximum(2 * heat, 1e-300))))

    @cached_property
    def _heat_step(self) -> CholeskySolver:
        time = (DIFFUSION_LENGTH * self._size) ** 2
        return CholeskySolver((diags_array(self._areas) + time * self._stiffness).tocsc())


def region_label(region: str | np.ndarray | Sequence[int]) -> str:
    """How messages call a region.

    Args:
        region: Its name, or the region itself.

    Returns:
        "region NAME", or "the region" if it has no name.
    """
    return f"region {region}" if isinstance(region, str) else "the region"


def vertex_field(region: np.ndarray | Sequence[int], v: int, label: str = "the region") -> Float[np.ndarray, " v"]:
    """Convert a region to a value in [0, 1] at each vertex.

    Args:
        region: Vertex indices, a boolean mask (v,), or floating-point numbers (v,) in [0, 1].
        v: Number of vertices.
        label: How messages call the region.

    Returns:
        1 inside and 0 outside, or the given numbers.

    Raises:
        SettingsError: If the region has another form, or holds no vertex.
    """
    region = np.asarray(region)
    if region.size == 0:
        raise SettingsError(f"{label} holds no vertex: list vertices, or paint some above 0")
    if region.dtype.kind in "iu" and region.ndim == 1 and region.min() >= 0 and region.max() < v:
        field = np.zeros(v)
        field[region] = 1.0
    elif region.dtype.kind in "bf" and region.shape == (v,) and (region >= 0).all() and (region <= 1).all():
        field = region.astype(np.float64)
    else:
        raise SettingsError(
            f"{label} must be a list of vertices in 0..{v - 1}, or {v} booleans or numbers in [0, 1]; "
            f"found {region.dtype} of shape {region.shape}"
        )
    if not field.any():
        raise SettingsError(f"{label} holds no vertex: list vertices, or paint some above 0")
    return field


def find_region(regions: Mapping[str, np.ndarray], name: str) -> np.ndarray:
    """Look up a region; a plural such as `ears` stands for the union of `left_ear` and `right_ear`.

    Args:
        regions: Regions by name.
        name: Name of a region, or plural of a pair.

    Returns:
        The region, in the form in which it is stored.

    Raises:
        SettingsError: If the name is unknown; the message lists the known names.
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
    """Scale overlapping fields so that they sum to at most 1 at every vertex.

    Args:
        fields: One field per region, in [0, 1].

    Returns:
        The fields, divided by their sum where it exceeds 1.
    """
    return fields / np.maximum(fields.sum(axis=0), 1.0)
