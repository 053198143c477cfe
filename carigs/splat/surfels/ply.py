"""Surfels as .ply files in the layouts of GaussianAvatars and SurFhead, for other viewers and converters.

Both store triangle-local values before activation. They differ in the axes of the local frame and in the number of
scales. GaussianAvatars: second axis = normal, third axis away from the third corner, three scales; SurFhead, and this
package: third axis = normal, two scales.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float

from carigs.errors import InputError, SettingsError
from carigs.files import writing
from carigs.mesh.ply_writer import ply_content
from carigs.readers.arrays import checked_array
from carigs.readers.meshes import MAX_FACES
from carigs.readers.ply import Ply, read_ply_vertices
from carigs.splat.colour.spherical_harmonics import num_coefficients
from carigs.splat.surfels.surfels import SH_COUNTS, Surfels, checked_surfels, initial_blend, to_arrays

LAYOUTS = ("surfhead", "gaussian_avatars")
REST = num_coefficients(3)  # both layouts always store degree 3
SPECULAR = 24  # specular features per surfel in SurFhead's layout, written as zeros
FLAT_LOG_SCALE = -10.0  # log scale along the normal of a disc in the layout of ellipsoids

# Columns: the axes of GaussianAvatars (edge, normal, away from the third corner) in ours (edge, towards it, normal).
OURS_FROM_GAUSSIAN_AVATARS = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def write_ply(file: Path, surfels: Surfels, layout: str = "surfhead") -> None:
    """Write surfels as binary little-endian .ply with float32 properties and the layout's name in a comment.

    Args:
        file: Path to write.
        surfels: Surfels.
        layout: `surfhead` (90 properties) or `gaussian_avatars` (63 properties, without the blend weights).

    Raises:
        SettingsError: If the layout is unknown.
    """
    if layout not in LAYOUTS:
        raise SettingsError(f"ply layout {layout} is unknown; choose {' or '.join(LAYOUTS)}")
    columns = _columns(to_arrays(surfels), layout)
    rows = np.empty(len(surfels), dtype=[(name, "<f4") for name in columns])
    for name, value in columns.items():
        rows[name] = value
    with writing(file) as part:
        part.write_bytes(ply_content(Ply("binary_little_endian", {"vertex": rows}, [f"frame={layout}"])))


def read_ply(file: Path, num_faces: int | None = None) -> Surfels:
    """Read surfels from either layout; the number of scales tells them apart.

    An ellipsoid becomes the disc of its two larger axes. Missing blend weights get SurFhead's initial values.

    Args:
        file: Path to read.
        num_faces: Number of the mesh's triangles, if it is known.

    Returns:
        Surfels, sorted by triangle. Degrees of the harmonics that are zero everywhere are dropped.

    Raises:
        InputError: If the file is missing or broken, lacks a property, or holds a number that is not finite or a
            binding that is no triangle.
    """
    rows = read_ply_vertices(file)
    rows_by_name = {name: rows[name] for name in rows.dtype.names}

    def properties(*names: str) -> Float[np.ndarray, "n k"]:
        for name in names:
            if name not in rows.dtype.names:
                raise InputError("this property is missing", file=file, field=name)
        columns = [checked_array(rows_by_name, name, (len(rows),), np.float32, file=file) for name in names]
        return np.stack(columns, axis=1)

    position, rotation = properties(*"xyz"), properties(*_numbered("rot", 4))
    if "scale_2" in rows.dtype.names:
        position, rotation, scale = _discs(position, rotation, properties(*_numbered("scale", 3)))
    else:
        scale = properties(*_numbered("scale", 2))
    n_rest = sum(name.startswith("f_rest_") for name in rows.dtype.names)
    if n_rest not in (3 * count for count in SH_COUNTS):
        problem = f"{n_rest} properties; {', '.join(str(3 * count) for count in SH_COUNTS)} are possible"
        raise InputError(problem, file=file, field="f_rest")
    rest = properties(*_numbered("f_rest", n_rest)).reshape(len(rows), 3, -1) if n_rest else np.zeros((len(rows), 3, 0))
    if "blend_weight_0" in rows.dtype.names:
        blend = properties(*_numbered("blend_weight", 4))
    else:
        blend = initial_blend(len(rows))
    arrays = {
        "binding": properties("binding_0")[:, 0],
        "position": position,
        "rotation": rotation,
        "log_scale": scale,
        "opacity": properties("opacity")[:, 0],
        "colour": properties(*_numbered("f_dc", 3)),
        "harmonics": _trimmed(rest.transpose(0, 2, 1)),
        "blend": blend,
    }
    return checked_surfels(arrays, MAX_FACES if num_faces is None else num_faces, file)


def _columns(arrays: dict[str, np.ndarray], layout: str) -> dict[str, np.ndarray]:
    n = len(arrays["binding"])
    position, rotation, scale = arrays["position"], arrays["rotation"], arrays["log_scale"]
    if layout == "gaussian_avatars":
        position = position @ OURS_FROM_GAUSSIAN_AVATARS
        rotation = _multiply(np.array([np.sqrt(0.5), -np.sqrt(0.5), 0, 0]), rotation)
        scale = np.concatenate([scale, np.full((n, 1), FLAT_LOG_SCALE)], axis=1)
    rest = np.zeros((n, REST, 3), np.float32)
    rest[:, : arrays["harmonics"].shape[1]] = arrays["harmonics"]
    blocks = [("xyz", position), (("nx", "ny", "nz"), np.zeros((n, 3)))]
    if layout == "surfhead":
        blocks.append((_numbered("blend_weight", 4), arrays["blend"]))
    blocks += [
        (_numbered("f_dc", 3), arrays["colour"]),
        (_numbered("f_rest", 3 * REST), rest.transpose(0, 2, 1).reshape(n, -1)),  # channel by channel
        (("opacity",), arrays["opacity"][:, None]),
        (_numbered("scale", scale.shape[1]), scale),
        (_numbered("rot", 4), rotation),
    ]
    if layout == "surfhead":
        blocks.append((_numbered("f_sg", SPECULAR), np.zeros((n, SPECULAR))))
    blocks.append((("binding_0",), arrays["binding"][:, None]))
    return {name: value[:, k] for names, value in blocks for k, name in enumerate(names)}


def _discs(position, rotation, scale):
    """GaussianAvatars' ellipsoids as discs in our axes: the axis of the smallest scale becomes the normal."""
    thinnest = scale.argmin(axis=1)
    # Even permutations of the axes that put the thinnest one last, as quaternions.
    turn = np.array([[0.5, 0.5, 0.5, 0.5], [0.5, -0.5, -0.5, -0.5], [1.0, 0.0, 0.0, 0.0]])[thinnest]
    order = np.array([[1, 2], [2, 0], [0, 1]])[thinnest]
    rotation = _multiply(np.array([np.sqrt(0.5), np.sqrt(0.5), 0, 0]), _multiply(rotation, turn))
    return position @ OURS_FROM_GAUSSIAN_AVATARS.T, rotation, np.take_along_axis(scale, order, axis=1)


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


def _numbered(name: str, count: int) -> tuple[str, ...]:
    return tuple(f"{name}_{k}" for k in range(count))


def _trimmed(rest: Float[np.ndarray, "n k 3"]) -> Float[np.ndarray, "n j 3"]:
    """Drop the degrees that are zero everywhere."""
    for degree in (0, 1, 2):
        if not rest[:, num_coefficients(degree) :].any():
            return rest[:, : num_coefficients(degree)]
    return rest
