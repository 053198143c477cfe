"""Warped frames and their mask flags on meshes that are folded, mirrored, collapsed, not manifold or not in view.

Example:
    PYTHONPATH=tests python -m stress.targets results/stress/targets.csv
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int32, UInt16

from carigs.capture import Camera
from carigs.gtstar import MaskFlag, face_mask_flags, flags_from_names, make_target, warp_frame
from carigs.gtstar.warp import DEPTH_TOLERANCE, Warp
from carigs.head import HeadModel
from carigs.raster import Visibility, compute_visibility
from carigs.settings import Gtstar
from evaluation.command_line import run
from stress.case import Case, Measure, difference, run_suite, violations
from stress.mesh_reference import face_volumes, pixel_rays
from stress.meshes import Mesh, ball, camera_at, sheet

COLOUR = 1e-5
"""Tolerance of colours, which are float32."""
PIXELS = 1e-4
"""Distance of a source from the border of the frame below which either side is right, in pixels."""
ROUNDING = 1e-12
"""Relative volume of a face and the camera below which the face is seen edge-on, from either side."""
VIEW = camera_at(1.0, (32, 24), 60.0)
SIZES = ((1, 1), (1, 7), (9, 1), (2, 2), (8, 16))
KINDS = ("perspective", "affine")


def cases() -> Iterator[Case]:
    """All cases.

    Yields:
        Cases.
    """
    for (mesh, make), (change, move) in product(MESHES.items(), CHANGES.items()):
        vertices, faces = make()
        yield Case(f"{mesh}: {change}", partial(sources, vertices, move(vertices), faces, VIEW))
        yield Case(f"{mesh}: back from {change}", partial(sources, move(vertices), vertices, faces, VIEW))
    for size, (change, move) in product(SIZES, CHANGES.items()):
        vertices, faces = sheet()
        camera = camera_at(1.0, size, 20.0)
        yield Case(
            f"image of {size[0]} x {size[1]}: {change}", partial(sources, vertices, move(vertices), faces, camera)
        )
    for (mesh, make), depth in product(MESHES.items(), (1.0, 0.3, 0.0)):
        yield Case(f"{mesh} at {depth:g} m: gamma 0", partial(gamma_zero, make(), camera_at(depth, (32, 24), 60.0)))
    for kind, (motion, matrix) in product(KINDS, MOTIONS.items()):
        yield Case(f"affine image, {kind} maps, {motion}", partial(affine_image, kind, matrix))
    for depth in (0.3, 0.1, 0.0, -0.1):
        yield Case(f"camera {depth:g} m from the middle of the head", partial(inside_out, depth))
    for name, fill in (("nothing", 0.0), ("everything", 1.0), ("a soft edge", 0.5)):
        for change in ("as it is", "smaller", "mirrored", "behind the camera"):
            yield Case(f"matte of {name}: {change}", partial(mattes, fill, CHANGES[change]))
    for flag in MaskFlag:
        yield Case(f"all faces have the flag {flag.name.lower()}", partial(all_masked, flag))
    yield Case("unknown kind of map", partial(unknown_map), invalid=True)
    yield Case("unknown flag", partial(unknown_flag), invalid=True)


def two_sheets() -> Mesh:
    """A small sheet in front of a larger one.

    Returns:
        The mesh.
    """
    (vertices, faces), (small, small_faces) = sheet(), sheet(4, 0.1, 0.1)
    return np.vstack([vertices, small - [0, 0, 0.1]]), np.vstack([faces, small_faces + len(vertices)])


def fins() -> Mesh:
    """Three sheets that share an edge: not a manifold.

    Returns:
        The mesh.
    """
    corners = np.array([[0, -0.1, 0], [0, 0.1, 0], [0.2, 0, 0.05], [-0.2, 0.02, 0.05], [0.05, 0, -0.2]])
    return corners, np.array([[0, 1, 2], [0, 3, 1], [0, 1, 4]], np.int32)


def doubled() -> Mesh:
    """A sheet with every face twice, once with its corners in reverse order.

    Returns:
        The mesh.
    """
    vertices, faces = sheet(5)
    return vertices, np.vstack([faces, faces[:, ::-1]])


def scattered() -> Mesh:
    """Triangles in random places, some with corners in one place.

    Returns:
        The mesh.
    """
    vertices = np.random.default_rng(5).uniform(-0.3, 0.3, (40, 3))
    faces = np.random.default_rng(6).integers(0, 40, (30, 3))
    return vertices, faces.astype(np.int32)


def _turned(degrees: float) -> Callable[[np.ndarray], np.ndarray]:
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return lambda v: v @ np.array([[cosine, 0, -sine], [0, 1, 0], [sine, 0, cosine]])


MESHES = {
    "sheet": sheet,
    "ball": partial(ball, 2, 0.15),
    "two sheets": two_sheets,
    "three sheets at an edge": fins,
    "every face twice": doubled,
    "scattered triangles": scattered,
}
CHANGES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "as it is": lambda v: v,
    "bigger": lambda v: 1.3 * v,
    "smaller": lambda v: 0.3 * v,
    "shifted": lambda v: v + np.array([0.07, -0.05, 0.02]),
    "turned by 60 degrees": _turned(60),
    "turned by 89.99 degrees": _turned(89.99),
    "mirrored": lambda v: v * [-1, 1, 1],
    "folded": lambda v: np.abs(v),
    "flat": lambda v: v * [1, 1, 0],
    "a line": lambda v: v * [1, 0, 0],
    "a point": lambda v: 0 * v,
    "behind the camera": lambda v: v - [0, 0, 5],
    "through the camera": lambda v: v * [1, 1, 8],
    "close to the camera": lambda v: v - [0, 0, 0.7],
    "with noise": lambda v: v + np.random.default_rng(1).normal(0, 0.02, v.shape),
}
MOTIONS = {
    "identity": np.eye(2),
    "scale": np.diag([1.25, 0.8]),
    "shear": np.array([[1.0, 0.4], [-0.1, 1.0]]),
    "nearly singular": np.array([[1.0, 0.0], [0.0, 0.05]]),
    "turn": np.array([[0.8, -0.6], [0.6, 0.8]]),
}


class Source(NamedTuple):
    """Where the pixels of a target come from."""

    pixels: Float64[np.ndarray, "n 2"]
    """In the frame; nan behind the camera."""
    depth: Float64[np.ndarray, " n"]
    """Depth of the point in the frame in metres."""


def source(natural: Visibility, caricature: Visibility, kind: str) -> Source:
    """Carry the point of each pixel on the caricature to the frame, independently of the maps of the warp.

    Args:
        natural: What the camera sees of the mesh in the frame.
        caricature: What it sees of the caricature.
        kind: `perspective`: the point of the triangle. `affine`: the affine map between its images.

    Returns:
        Sources, in the order of `np.nonzero(caricature.face >= 0)`.
    """
    y, x = np.nonzero(caricature.face >= 0)
    corners = natural.faces[caricature.face[y, x]]
    camera = caricature.camera
    with np.errstate(all="ignore"):
        if kind == "affine":
            flat = np.concatenate([caricature.pixels[corners], np.ones((len(x), 3, 1))], axis=2)
            weights = _solved(flat, np.column_stack([x + 0.5, y + 0.5, np.ones(len(x))]))
            return Source(np.einsum("nk,nkc->nc", weights, natural.pixels[corners]), np.full(len(x), np.nan))
        weights = _solved(caricature.camera_points[corners], pixel_rays(camera)[y, x])
        points = np.einsum("nk,nkc->nc", weights / weights.sum(axis=1, keepdims=True), natural.camera_points[corners])
        pixels = points[:, :2] / points[:, 2:] * [camera.fx, camera.fy] + [camera.cx, camera.cy]
        return Source(np.where(points[:, 2:] > 0, pixels, np.nan), points[:, 2])


def _solved(rows: Float64[np.ndarray, "n 3 3"], right: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
    """Solutions w of rows^T w = right, nan for singular systems."""
    regular = np.abs(np.linalg.det(rows)) > 0
    result = np.full(right.shape, np.nan)
    result[regular] = np.linalg.solve(rows[regular].transpose(0, 2, 1), right[regular][:, :, None])[:, :, 0]
    return result


def noise_image(camera: Camera, seed: int = 0) -> Float32[np.ndarray, "h w 3"]:
    """Image of random colours.

    Args:
        camera: Camera with its size.
        seed: Seed of the colours.

    Returns:
        The image.
    """
    return np.random.default_rng(seed).random((camera.height, camera.width, 3)).astype(np.float32)


def warped(
    image: np.ndarray, natural: Visibility, caricature: Visibility, background: float = 1.0, **settings: object
) -> Warp:
    """Warp without flags of faces and frames.

    Args:
        image: The frame.
        natural: What the camera sees of the mesh in the frame.
        caricature: What it sees of the caricature.
        background: Grey value of the background.
        **settings: Settings of the stage.

    Returns:
        The warp.
    """
    face_flags, frame_flags = np.zeros(len(natural.faces), np.uint16), np.zeros(natural.face.shape, np.uint16)
    return warp_frame(image, natural, caricature, face_flags, frame_flags, Gtstar(**settings), background)


def sources(
    natural: Float[np.ndarray, "v 3"],
    caricature: Float[np.ndarray, "v 3"],
    faces: Int32[np.ndarray, "f 3"],
    camera: Camera,
) -> Iterator[Measure]:
    """Colours and flags of a warp agree with the sources of its pixels.

    Args:
        natural: Vertices of the mesh in the frame.
        caricature: Vertices of the caricature.
        faces: Vertex indices of the triangles.
        camera: The camera of both.

    Yields:
        Errors, for both kinds of maps, with and without coverage.
    """
    ends = [compute_visibility(vertices, faces, camera) for vertices in (natural, caricature)]
    image = noise_image(camera)
    before, after = (face_volumes((vertices, faces), camera) for vertices in (natural, caricature))
    turned, sure = (before > 0) != (after > 0), np.minimum(np.abs(before), np.abs(after)) > ROUNDING
    on_mesh = ends[1].face >= 0
    for kind, samples in product(KINDS, (1, 3)):
        settings = {"warp": kind, "supersampling": samples}
        warp = warped(image, *ends, background=1.0, **settings)
        flags = warp.mask_flags
        yield violations("colours beyond [0, 1]", ~((warp.colour >= 0) & (warp.colour <= 1)))
        yield violations("pixels off the mesh that are not background", (warp.colour[~on_mesh] != 1.0))
        yield violations("flags off the mesh", flags[~on_mesh] != 0)
        face = ends[1].face[on_mesh]
        told = _has(flags[on_mesh], MaskFlag.NEWLY_VISIBLE)
        yield violations("changes of side that are not told", (told != turned[face]) & sure[face])
        constant = warped(np.full_like(image, 0.3), *ends, background=0.3, **settings)
        yield difference("a constant image", constant.colour, 0.3, COLOUR)
        yield from _flags_agree(flags[on_mesh], source(*ends, kind), ends, kind)


def _has(flags: UInt16[np.ndarray, "*n"], flag: MaskFlag) -> Bool[np.ndarray, "*n"]:
    return (flags & np.uint16(flag.value)) > 0


def _flags_agree(
    flags: UInt16[np.ndarray, " n"], found: Source, ends: list[Visibility], kind: str
) -> Iterator[Measure]:
    """Pixels without flags have a source; pixels from beyond the frame have the flag that says so."""
    natural, camera = ends[0], ends[0].camera
    size = np.array([camera.width, camera.height])
    if kind == "affine" and not (natural.camera_points[natural.faces, 2] > 1e-3).all():
        return  # image positions of corners behind the camera mean nothing
    with np.errstate(invalid="ignore"):
        beyond = ~((found.pixels >= 0) & (found.pixels < size)).all(axis=1)
        sure = ~(np.minimum(np.abs(found.pixels), np.abs(found.pixels - size)) < PIXELS).any(axis=1)
        sure &= np.abs(found.depth) > 1e-6 if kind == "perspective" else np.isfinite(found.pixels).all(axis=1)
    yield violations("sources beyond the frame", (_has(flags, MaskFlag.OUTSIDE_IMAGE) != beyond) & sure)
    if kind == "affine":
        return
    trusted = (flags == 0) & sure & ~beyond
    corner = np.floor(np.maximum(found.pixels[trusted] - 0.5, 0)).astype(int)
    shown = np.zeros(len(corner), bool)
    y, x = np.nonzero(ends[1].face >= 0)
    face = ends[1].face[y, x][trusted]
    depth = natural.fragments.depth
    for dx, dy in product((0, 1), (0, 1)):
        column, row = np.minimum(corner + np.array([dx, dy]), size - 1).T
        plane = natural.depth_planes[face]
        with np.errstate(all="ignore"):
            expected = 1 / (plane[:, 0] * (column + 0.5) + plane[:, 1] * (row + 0.5) + plane[:, 2])
            shown |= np.abs(depth[row, column] - expected) <= 1.001 * DEPTH_TOLERANCE + 1e-5 * expected
    yield violations("pixels without flags whose point no pixel of the frame shows", ~shown)


def gamma_zero(mesh: Mesh, camera: Camera) -> Iterator[Measure]:
    """The target at level 0 is the frame, without flags.

    Args:
        mesh: The mesh.
        camera: The camera.

    Yields:
        Differences and flags.
    """
    seen, image = compute_visibility(*mesh, camera), noise_image(camera)
    on_mesh = seen.face >= 0
    for kind, samples in product(KINDS, (1, 4)):
        if kind == "affine" and not (seen.camera_points[mesh[1], 2] > 1e-3).all():
            continue
        warp = warped(image, seen, seen, warp=kind, supersampling=samples)
        yield difference(f"colours, {kind}", warp.colour[on_mesh], image[on_mesh], COLOUR)
        yield violations(f"flags, {kind}", warp.mask_flags != 0)


def affine_image(kind: str, matrix: Float[np.ndarray, "2 2"]) -> Iterator[Measure]:
    """An image that is affine in the position, under an affine motion in the image plane.

    Args:
        kind: Kind of the maps.
        matrix: Linear part of the motion.

    Yields:
        Difference from the closed form, away from the border of the sheet.
    """
    vertices, faces = sheet()
    moved = vertices.copy()
    moved[:, :2] = vertices[:, :2] @ matrix.T + [0.011, -0.007]
    ends = [compute_visibility(v, faces, VIEW) for v in (vertices, moved)]
    x, y = np.meshgrid(np.arange(VIEW.width) + 0.5, np.arange(VIEW.height) + 0.5)
    image = np.stack([x / 40, y / 40, 0.4 + 0.01 * x - 0.02 * y + 0.1], axis=2).astype(np.float32)
    warp = warped(image, *ends, warp=kind, supersampling=1)
    target = np.stack([x - VIEW.cx, y - VIEW.cy], axis=-1) / VIEW.fx  # at a depth of 1 m
    place = (target - [0.011, -0.007]) @ np.linalg.inv(matrix).T
    px, py = (place * VIEW.fx + [VIEW.cx, VIEW.cy]).transpose(2, 0, 1)
    expected = np.stack([px / 40, py / 40, 0.4 + 0.01 * px - 0.02 * py + 0.1], axis=2)
    inner = (np.abs(place) < np.array([0.2, 0.15]) - 1.5 / VIEW.fx).all(axis=2) & (ends[1].face >= 0)
    yield Measure("pixels compared, fewer than 9", float(9 - inner.sum()), 0.0)
    yield difference("colours", warp.colour[inner], expected[inner], COLOUR)
    yield violations("pixels not trusted", _has(warp.mask_flags[inner], MaskFlag.OCCLUDED))


def bald_model(mesh: Mesh) -> HeadModel:
    """Head model of a mesh that nothing moves, without regions.

    Args:
        mesh: The mesh.

    Returns:
        The model.
    """
    v = len(mesh[0])
    return HeadModel(
        v_template=mesh[0].astype(np.float32),
        faces=mesh[1],
        shapedirs=np.zeros((v, 3, 1), np.float32),
        posedirs=np.zeros((v, 3, 0), np.float32),
        joint_regressor=np.zeros((1, v), np.float32),
        weights=np.ones((v, 1), np.float32),
        parents=np.array([-1]),
        num_identity=0,
    )


def inside_out(depth: float) -> Iterator[Measure]:
    """A camera at or inside the head: the target says whether the mesh's front is seen.

    Args:
        depth: Depth of the middle of the head, whose radius is 0.15 m.

    Yields:
        Errors.
    """
    vertices, faces = ball(2, 0.15)
    camera = camera_at(depth, (32, 24), 20.0)
    natural, caricature = (compute_visibility(v, faces, camera) for v in (vertices, 1.01 * vertices))
    model = bald_model((vertices, faces))
    foreground = np.ones((24, 32), np.float32)
    flags = face_mask_flags(model, Gtstar())
    target = make_target(noise_image(camera), foreground, natural, caricature, model, flags, Gtstar())
    yield Measure("wrong side", float(target.front_visible != (depth > 0.2)))
    yield violations("colours beyond [0, 1]", ~((target.colour >= 0) & (target.colour <= 1)))
    if depth < 0.1:
        yield violations("pixels off the mesh, seen from inside", target.caricature.face < 0)


def mattes(fill: float, move: Callable[[np.ndarray], np.ndarray]) -> Iterator[Measure]:
    """Mattes that are empty, full, or do not fit the mesh.

    Args:
        fill: Value of the matte; 0.5: a matte of the mesh's outline, blurred.
        move: From the vertices in the frame to those of the caricature.

    Yields:
        Contradictions of flags and surfaces.
    """
    vertices, faces = ball(2, 0.15)
    model = bald_model((vertices, faces))
    natural, caricature = (compute_visibility(v, faces, VIEW) for v in (vertices, move(vertices)))
    foreground = np.full((24, 32), fill, np.float32)
    if fill == 0.5:
        foreground = 0.5 * (natural.face >= 0).astype(np.float32)
    flags = face_mask_flags(model, Gtstar())
    target = make_target(noise_image(VIEW), foreground, natural, caricature, model, flags, Gtstar())
    on_mesh = caricature.face >= 0
    yield violations("flags of the outside on the mesh", _has(target.mask_flags, MaskFlag.OUTSIDE_MESH) & on_mesh)
    inner = MaskFlag.NEWLY_VISIBLE | MaskFlag.OCCLUDED | MaskFlag.GRAZING | MaskFlag.STRETCHED | MaskFlag.OUTSIDE_IMAGE
    yield violations("flags of the mesh off it", _has(target.mask_flags, inner) & ~on_mesh)
    yield violations("colours off the mesh", target.colour[~on_mesh] != 1.0)
    stray = (foreground > 0.5) & ~on_mesh
    if fill == 1.0:
        yield violations("foreground off the mesh that is trusted", stray & (target.mask_flags == 0))


def all_masked(flag: MaskFlag) -> Iterator[Measure]:
    """A flag of all faces is the flag of every pixel on the mesh, and changes no colour.

    Args:
        flag: The flag.

    Yields:
        Pixels without it.
    """
    vertices, faces = sheet()
    seen, image = compute_visibility(vertices, faces, VIEW), noise_image(VIEW)
    flags = np.full(len(faces), flag.value, np.uint16)
    warp = warp_frame(image, seen, seen, flags, np.zeros(seen.face.shape, np.uint16), Gtstar())
    yield violations("pixels", _has(warp.mask_flags, flag) != (seen.face >= 0))
    yield difference("colours", warp.colour, warped(image, seen, seen).colour, 0.0)


def unknown_map() -> list[Measure]:
    """A kind of map that does not exist.

    Returns:
        Nothing: it is an error.
    """
    seen = compute_visibility(*sheet(), VIEW)
    warped(noise_image(VIEW), seen, seen, warp="projective")
    return []


def unknown_flag() -> list[Measure]:
    """A mask flag that does not exist.

    Returns:
        Nothing: it is an error.
    """
    flags_from_names(["hair", "beard"])
    return []


if __name__ == "__main__":
    run(lambda: run_suite(__doc__, "targets", cases()))
