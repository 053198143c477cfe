"""The posed mesh in the cameras of a capture: is the head where the cameras look?"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from carigs.capture import Camera, Capture, Frame
from carigs.capture.evenly_spread import evenly_spread
from carigs.errors import InputError, MeshError, collecting
from carigs.head import HeadModel, pose
from carigs.mesh.triangle_mesh import diagonal, vertex_normals
from carigs.plausibility.findings import Finding
from carigs.raster import Visibility, compute_visibility
from carigs.raster.rasterizer import NEAR
from carigs.raster.vertex_colours import visible_vertices

VERTICES = 1500
"""Number of vertices whose colours are compared."""
STRETCH = 2.0
"""The diagonal of a posed head is that of the template up to this factor: an open mouth adds a tenth."""
SMALLEST = 16
"""Size of the head in an image, in pixels, below which nothing can be reconstructed."""

OUT_OF_SIGHT = "the head is behind every camera, or outside every image"
COMPARE_ORIGINS = "compare the unit and the origin of the translations with those of the cameras"
COMPARE_CAMERAS = "compare the camera's unit, axes and focal length with the others'"
AXES_HINT = "cameras are OpenGL camera-to-world transforms in metres (x right, y up, z backward)"


class ImpossibleView(InputError):
    """No camera sees the head of a timestep, or one lies inside it: another mistake may be the cause."""


class MeshView(NamedTuple):
    """What a camera sees of the posed mesh."""

    frame: Frame
    visibility: Visibility
    pixels: Float32[np.ndarray, "n 2"]
    """Image positions of some of the vertices, the same in all views; NaN where they are hidden."""


def pose_views(
    capture: Capture,
    frames: Mapping[int, Mapping[int, Frame]],
    findings: list[Finding],
    errors: list[InputError] | None = None,
) -> Iterator[MeshView]:
    """Pose the mesh and project it into the cameras, one timestep after the other.

    A caller that drops each view saves memory: the views of one timestep of `ict_s1` take 67 MB together.

    Args:
        capture: The capture.
        frames: Frames by timestep and camera.
        findings: What is likely to be wrong is added.
        errors: Receives the errors of timesteps, which are left out then; None to raise the first.

    Yields:
        The views of the frames in which the head is seen.

    Raises:
        InputError: If no camera sees the head of a timestep, or a camera is inside it, or the mesh is torn.
    """
    model = capture.model
    some, blind = spread_vertices(model), {c: 0 for cameras in frames.values() for c in cameras}
    for timestep, cameras in frames.items():
        seen: dict[int, float] = {}
        with collecting(errors):
            vertices = _posed(capture, timestep)
            for c, frame in cameras.items():
                if lies_inside(capture.camera(frame).centre, vertices, model.faces):
                    problem = f"camera {c} lies inside the head mesh of timestep {timestep}; {AXES_HINT}"
                    field = f"camera {c}: transform_matrix"
                    raise ImpossibleView(problem, file=capture.root, field=field, remedy=COMPARE_ORIGINS)
            seen = {c: _projected_size(vertices[some], capture.camera(frame)) for c, frame in cameras.items()}
            blind = {c: count + (seen.get(c) == 0) for c, count in blind.items()}
            if not any(seen.values()):
                file = capture.root / capture.parameter_files[timestep]
                problem = f"{OUT_OF_SIGHT}; {AXES_HINT}"
                raise ImpossibleView(problem, file=file, field="translation", remedy=COMPARE_ORIGINS)
        if not any(seen.values()):
            continue
        normals = vertex_normals(vertices, model.faces)
        for c, frame in cameras.items():
            if not seen[c]:
                continue
            if 0 < seen[c] < SMALLEST:
                details = f"{seen[c]:.2g} pixels"
                kind = "the head is tiny in the image"
                findings.append(Finding(kind, capture.root, f"camera {c}", details, COMPARE_CAMERAS))
            visibility = compute_visibility(vertices, model.faces, capture.camera(frame))
            visible = visible_vertices(visibility, vertices, normals)
            pixels = np.full((len(vertices), 2), np.nan, np.float32)
            pixels[visible.index] = visible.pixels
            yield MeshView(frame, visibility, pixels[some])
    for c, count in sorted(blind.items()):
        if 0 < sum(c in cameras for cameras in frames.values()) == count:
            details = "see its transform_matrix, fl_x and cx"
            kind = "the camera never sees the head"
            findings.append(Finding(kind, capture.root, f"camera {c}", details, COMPARE_CAMERAS))


def _posed(capture: Capture, timestep: int) -> Float[np.ndarray, "v 3"]:
    file = capture.root / capture.parameter_files[timestep]
    try:
        vertices = pose(capture.model, capture.parameters(timestep))
    except MeshError as error:
        raise InputError(str(error), file=file) from error
    extent, size = diagonal(vertices), diagonal(capture.model.v_template)
    if not size / STRETCH < extent < STRETCH * size:
        problem = f"the posed head is {extent:.3g} m large, the template {size:.3g} m"
        raise InputError(problem, file=file, remedy="see expr, neck_pose and the head model's weights")
    return vertices


def spread_vertices(model: HeadModel) -> np.ndarray:
    """Vertices whose colours are compared.

    Args:
        model: The head model.

    Returns:
        Indices of at most `VERTICES` vertices.
    """
    return np.array(evenly_spread(range(len(model.v_template)), VERTICES))


def head_faces(model: HeadModel) -> Bool[np.ndarray, " f"]:
    """Faces above the neck: mattes may end at the neck, as those of GaussianAvatars do.

    Args:
        model: The head model.

    Returns:
        Whether each face is neither in the regions `neck` and `boundary` nor moved mainly by the root joint, as
        shoulders are. Each of the two is ignored if it leaves less than a fifth of the faces.
    """
    above = np.ones(len(model.faces), bool)
    for below in (model.vertex_region("neck", "boundary"), model.weights[:, 0] > 0.5):
        rest = above & ~below[model.faces].any(axis=1)
        above = rest if rest.mean() > 0.2 else above
    return above


def lies_inside(
    point: Float[np.ndarray, "3"], vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> bool:
    """Whether a point lies inside a mesh, which may be open at the neck.

    Args:
        point: The point.
        vertices: Vertices of the mesh, in the same axes and unit.
        faces: Triangles.

    Returns:
        Whether the solid angle of the mesh (van Oosterom and Strackee 1983) is more than half of the sphere.
    """
    offsets = np.asarray(vertices, np.float64) - point
    if (offsets.min(axis=0) > 0).any() or (offsets.max(axis=0) < 0).any():  # outside the bounding box
        return False
    length, (a, b, c) = np.linalg.norm(offsets, axis=1), np.moveaxis(offsets[faces], 1, 0)
    la, lb, lc = length[faces].T
    volume = np.einsum("fi,fi->f", a, np.cross(b, c))
    dots = np.einsum("fi,fi->f", a, b) * lc + np.einsum("fi,fi->f", b, c) * la + np.einsum("fi,fi->f", c, a) * lb
    angle = 2 * np.arctan2(volume, la * lb * lc + dots).sum()
    return bool(abs(angle) > 2 * np.pi)


def _projected_size(vertices: Float[np.ndarray, "v 3"], camera: Camera) -> float:
    """Size of the head's bounding box within the image in pixels, 0 if it is not seen."""
    pixels, depth = camera.project(vertices)
    pixels = pixels[depth > NEAR]
    if not len(pixels):
        return 0.0
    limit = np.array([camera.width, camera.height])
    extent = np.minimum(pixels.max(axis=0), limit) - np.maximum(pixels.min(axis=0), 0)
    return float(extent.max()) if extent.min() > 0 else 0.0
