"""Surfels as .ply files in the layouts of GaussianAvatars and SurFhead: read, and written so that nothing is lost.

Both store triangle-local values before activation. They differ in the axes of the local frame and in the number of
scales. GaussianAvatars: second axis = normal, third axis away from the third corner, three scales; SurFhead, and this
package: third axis = normal, two scales.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from carigs.errors import InputError, SettingsError
from carigs.mesh.ply_writer import ply_content
from carigs.readers.arrays import checked_array
from carigs.readers.mesh_files.meshes import MAX_FACES
from carigs.readers.mesh_files.ply import Ply, read_ply_vertices
from carigs.splat.colour.spherical_harmonics import num_coefficients
from carigs.splat.surfels.surfels import SH_COUNTS, Surfels, checked_surfels, initial_blend, to_arrays
from carigs.system.files import writing

LAYOUTS = ("surfhead", "gaussian_avatars")
REST = num_coefficients(3)  # both layouts always store degree 3
SPECULAR = 24
"""Specular features per surfel in SurFhead's layout."""
FLAT_LOG_SCALE = -10.0
"""Log scale along the normal of a disc in the layout of ellipsoids, in units of the triangle."""
UNRENDERED = {"normal_axis": ((), np.int8), "thickness": ((), np.float32), "specular": ((SPECULAR,), np.float32)}
"""What else the layouts store, its shape for one surfel and its type: the axis of GaussianAvatars' ellipsoid that
became the normal, the log scale along it, and SurFhead's specular features. Kept beside the surfels, it is written
again."""

# Columns: the axes of GaussianAvatars (edge, normal, away from the third corner) in ours (edge, towards it, normal).
OURS_FROM_GAUSSIAN_AVATARS = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
_QUATERNION = np.array([np.sqrt(0.5), np.sqrt(0.5), 0, 0])  # the same rotation
# By the thinnest axis of an ellipsoid: the rotation that makes it the third one, as a quaternion, and the other two.
_NORMAL_LAST = np.array([[0.5, 0.5, 0.5, 0.5], [0.5, -0.5, -0.5, -0.5], [1.0, 0.0, 0.0, 0.0]])
_DISC_AXES = np.array([[1, 2], [2, 0], [0, 1]])
_CONJUGATE = np.array([1, -1, -1, -1])


class SurfelPly(NamedTuple):
    """Content of a .ply file of surfels."""

    surfels: Surfels
    layout: str
    """One of `LAYOUTS`."""
    has_blend_weights: bool
    """Whether the file holds the weights of Jacobian blend skinning."""
    unrendered: dict[str, np.ndarray]
    """Arrays of `UNRENDERED`, in the order of the surfels."""


def write_ply(
    file: Path,
    surfels: Surfels,
    layout: str = "surfhead",
    *,
    blend_weights: bool = True,
    unrendered: Mapping[str, np.ndarray] | None = None,
) -> None:
    """Write surfels as binary little-endian .ply with float32 properties and the layout's name in a comment.

    Args:
        file: Path to write.
        surfels: Surfels.
        layout: `surfhead` (90 properties) or `gaussian_avatars` (63 properties, never with blend weights).
        blend_weights: Whether SurFhead's layout has the blend weights; it has 86 properties without them.
        unrendered: Arrays of `UNRENDERED`; discs have no thickness and no specular features if they are missing.

    Raises:
        SettingsError: If the layout is unknown.
    """
    if layout not in LAYOUTS:
        raise SettingsError(f"ply layout {layout} is unknown; choose {' or '.join(LAYOUTS)}")
    write_float_ply(file, _columns(to_arrays(surfels), layout, blend_weights, unrendered or {}), f"frame={layout}")


def write_float_ply(file: Path, columns: Mapping[str, Float[np.ndarray, " n"]], *comments: str) -> None:
    """Write a binary little-endian .ply with the element `vertex`, whose properties are all float32.

    Args:
        file: Path to write.
        columns: Values of each property by name, in the order of the file.
        *comments: Comments of the header.
    """
    rows = np.empty(len(next(iter(columns.values()))), dtype=[(name, "<f4") for name in columns])
    for name, value in columns.items():
        rows[name] = value
    with writing(file) as part:
        part.write_bytes(ply_content(Ply("binary_little_endian", {"vertex": rows}, list(comments))))


def read_ply(file: Path, num_faces: int | None = None) -> SurfelPly:
    """Read surfels from either layout; the number of scales tells them apart.

    An ellipsoid becomes the disc of its two larger axes. Missing blend weights get SurFhead's initial values.

    Args:
        file: Path to read.
        num_faces: Number of the mesh's triangles, if it is known.

    Returns:
        Surfels, sorted by triangle, and what else the file holds. Degrees of the harmonics that are zero everywhere are
        dropped.

    Raises:
        InputError: If the file is missing or broken, lacks a property, or holds a number that is not finite or a
            binding that is no triangle.
    """
    rows = read_ply_vertices(file)
    names = rows.dtype.names
    rows_by_name = {name: rows[name] for name in names}

    def properties(*wanted: str) -> Float[np.ndarray, "n k"]:
        for name in wanted:
            if name not in names:
                raise InputError("this property is missing", file=file, field=name)
            if rows[name].dtype.kind != "f" and name != "binding_0":
                raise InputError("whole numbers, expected float", file=file, field=name)
        columns = [checked_array(rows_by_name, name, (len(rows),), np.float32, file=file) for name in wanted]
        return np.stack(columns, axis=1)

    if "binding_0" not in names:
        raise InputError("no triangles: splats without a rig", file=file, field="binding_0")
    position, rotation = properties(*"xyz"), properties(*numbered("rot", 4))
    layout = "gaussian_avatars" if "scale_2" in names else "surfhead"
    unrendered = {}
    if layout == "gaussian_avatars":
        scales = properties(*numbered("scale", 3))
        axis = scales.argmin(axis=1)
        position, rotation, scale = _discs(position, rotation, scales, axis)
        unrendered = {"normal_axis": axis.astype(np.int8), "thickness": scales.min(axis=1)}
    else:
        scale = properties(*numbered("scale", 2))
        if "f_sg_0" in names:
            unrendered = {"specular": properties(*numbered("f_sg", SPECULAR))}
    n_rest = sum(name.startswith("f_rest_") for name in names)
    if n_rest not in (3 * count for count in SH_COUNTS):
        problem = f"{n_rest} properties; {', '.join(str(3 * count) for count in SH_COUNTS)} are possible"
        raise InputError(problem, file=file, field="f_rest")
    rest = properties(*numbered("f_rest", n_rest)).reshape(len(rows), 3, -1) if n_rest else np.zeros((len(rows), 3, 0))
    has_blend_weights = "blend_weight_0" in names
    arrays = {
        "binding": properties("binding_0")[:, 0],
        "position": position,
        "rotation": rotation,
        "log_scale": scale,
        "opacity": properties("opacity")[:, 0],
        "colour": properties(*numbered("f_dc", 3)),
        "harmonics": _trimmed(rest.transpose(0, 2, 1)),
        "blend": properties(*numbered("blend_weight", 4)) if has_blend_weights else initial_blend(len(rows)),
    }
    surfels = checked_surfels(arrays, MAX_FACES if num_faces is None else num_faces, file)
    order = np.argsort(arrays["binding"], kind="stable")  # as the surfels are sorted
    return SurfelPly(surfels, layout, has_blend_weights, {name: value[order] for name, value in unrendered.items()})


def _columns(
    arrays: Mapping[str, np.ndarray], layout: str, blend_weights: bool, unrendered: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    n = len(arrays["binding"])
    position, rotation, scale = arrays["position"], arrays["rotation"], arrays["log_scale"]
    if layout == "gaussian_avatars":
        axis = unrendered.get("normal_axis", np.full(n, 2))
        thickness = unrendered.get("thickness", np.full(n, FLAT_LOG_SCALE))
        position, rotation, scale = _ellipsoids(position, rotation, scale, axis, thickness)
    rest = np.zeros((n, REST, 3), np.float32)
    rest[:, : arrays["harmonics"].shape[1]] = arrays["harmonics"]
    blocks = [("xyz", position), (("nx", "ny", "nz"), np.zeros((n, 3)))]
    if layout == "surfhead" and blend_weights:
        blocks.append((numbered("blend_weight", 4), arrays["blend"]))
    blocks += [
        (numbered("f_dc", 3), arrays["colour"]),
        (numbered("f_rest", 3 * REST), rest.transpose(0, 2, 1).reshape(n, -1)),  # channel by channel
        (("opacity",), arrays["opacity"][:, None]),
        (numbered("scale", scale.shape[1]), scale),
        (numbered("rot", 4), rotation),
    ]
    if layout == "surfhead":
        blocks.append((numbered("f_sg", SPECULAR), unrendered.get("specular", np.zeros((n, SPECULAR)))))
    blocks.append((("binding_0",), arrays["binding"][:, None]))
    return {name: value[:, k] for names, value in blocks for k, name in enumerate(names)}


def _discs(
    position: Float[np.ndarray, "n 3"],
    rotation: Float[np.ndarray, "n 4"],
    scale: Float[np.ndarray, "n 3"],
    axis: Int[np.ndarray, " n"],
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 4"], Float[np.ndarray, "n 2"]]:
    """GaussianAvatars' ellipsoids as discs in our axes: one axis of each becomes the normal."""
    rotation = _multiply(_QUATERNION, _multiply(rotation, _NORMAL_LAST[axis]))
    return position @ OURS_FROM_GAUSSIAN_AVATARS.T, rotation, np.take_along_axis(scale, _DISC_AXES[axis], axis=1)


def _ellipsoids(
    position: Float[np.ndarray, "n 3"],
    rotation: Float[np.ndarray, "n 4"],
    scale: Float[np.ndarray, "n 2"],
    axis: Int[np.ndarray, " n"],
    thickness: Float[np.ndarray, " n"],
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 4"], Float[np.ndarray, "n 3"]]:
    """Inverse of `_discs`."""
    rotation = _multiply(_multiply(_QUATERNION * _CONJUGATE, rotation), _NORMAL_LAST[axis] * _CONJUGATE)
    scales = np.empty((len(scale), 3))
    np.put_along_axis(scales, _DISC_AXES[axis], scale, axis=1)
    np.put_along_axis(scales, axis[:, None], thickness[:, None], axis=1)
    return position @ OURS_FROM_GAUSSIAN_AVATARS, rotation, scales


def _multiply(p: Float[np.ndarray, "*#n 4"], q: Float[np.ndarray, "*#n 4"]) -> Float[np.ndarray, "n 4"]:
    """Quaternion product, wxyz."""
    a, b, c, d = np.moveaxis(p, -1, 0)
    w, x, y, z = np.moveaxis(q, -1, 0)
    product = [
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    ]
    return np.stack(product, axis=-1)


def numbered(name: str, count: int) -> tuple[str, ...]:
    """Names of numbered properties.

    Args:
        name: What precedes the number.
        count: How many.

    Returns:
        The names, from `name_0`.
    """
    return tuple(f"{name}_{k}" for k in range(count))


def _trimmed(rest: Float[np.ndarray, "n k 3"]) -> Float[np.ndarray, "n j 3"]:
    """Drop the degrees that are zero everywhere."""
    for degree in (0, 1, 2):
        if not rest[:, num_coefficients(degree) :].any():
            return rest[:, : num_coefficients(degree)]
    return rest
