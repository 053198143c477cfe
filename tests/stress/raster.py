"""The triangle rasterizer against rays in float64: any camera, any triangle, every pixel covered once.

Example:
    PYTHONPATH=tests python -m stress.raster results/stress/raster.csv
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import combinations_with_replacement, product

import cv2
import numpy as np
from scipy.spatial import Delaunay

from carigs.capture import Camera
from carigs.raster import compute_visibility
from carigs.raster.bit_masks import greater
from carigs.raster.rasterizer import NEAR
from evaluation.command_line import run
from stress.case import Case, Measure, difference, run_suite, violations
from stress.mesh_reference import camera_points, face_volumes, pixel_rays, trace
from stress.meshes import Mesh, ball, camera_at, sheet

DEPTH = 1e-6
"""Largest relative error of a depth: inverse depths are stored in float32."""


def cases() -> Iterator[Case]:
    """All cases.

    Yields:
        Cases.
    """
    for (mesh, make), (view, camera), size in product(MESHES.items(), VIEWS.items(), SIZES):
        resized = replace(camera, width=size[0], height=size[1])
        yield Case(f"{mesh}, {view}, {size[0]} x {size[1]}", partial(as_traced, make(), resized))
    for scale, shift in product((0.02, 1.0, 1e3, 1e6), (0.0, 1e3, 1e6)):
        yield Case(f"scene times {scale:g}, {shift:g} m away", partial(moved_scene, scale, shift))
    corners = (-1.0, 0.0, 1e-12, NEAR, np.nextafter(NEAR, 1), 0.0100001, 1.5)
    for depths in combinations_with_replacement(corners, 3):
        yield Case("corners at depths " + ", ".join(f"{depth:.17g}" for depth in depths), partial(one_face, depths))
    for seed, grid in product(range(12), (0.0, 0.5, 1.0)):
        yield Case(f"triangulation {seed}, corners on multiples of {grid:g} pixels", partial(covered_once, seed, grid))
    for seed, inside in product(range(12), (False, True)):
        place = "inside" if inside else "outside"
        yield Case(f"closed surface {seed} from {place}", partial(closed_surface, seed, inside))
    for (mesh, vertices), n in product(
        (
            ("a ball", ball(1)),
            ("slivers", MESHES["slivers"]()),
            ("triangles everywhere", MESHES["triangles everywhere"]()),
        ),
        (1, 2, 3, 8),
    ):
        yield Case(f"coverage of {mesh} by {n} x {n} samples", partial(coverage, vertices, n))
    for size, radius in product(((1, 1), (1, 70), (70, 1), (63, 9), (64, 8), (65, 17)), (0, 1, 5, 64)):
        yield Case(f"mask of {size[0]} x {size[1]} dilated by {radius}", partial(dilated_mask, size, radius))
    for count in (2, 7):
        yield Case(f"the same face {count} times", partial(repeated_face, count))
    for turn in range(6):
        yield Case(f"corners of the faces in order {turn}", partial(turned_corners, turn))
    yield Case("front and back in one place", front_and_back)
    for value, axis in product((np.nan, np.inf, -np.inf, 1e20, -1e20, 1e160, 1e300), range(3)):
        yield Case(f"coordinate {axis} of a corner is {value:g}", partial(odd_corner, value, axis))
    for size, axis, front in product((1e9, 1e20, -1e20, 1e150), (0, 1), (True, False)):
        side = "front" if front else "back"
        yield Case(f"{side} of a triangle of {size:g} m along axis {axis}", partial(far_triangle, size, axis, front))
    yield Case("no faces", partial(as_traced, (np.zeros((3, 3)), np.zeros((0, 3), np.int32)), camera_at()))


def random_triangles(seed: int, count: int, size: float, aspect: float = 1.0, depth: float = 2.0) -> Mesh:
    """Triangles in random places around the optical axis, in the world of `camera_at`.

    Args:
        seed: Seed of the places.
        count: Number of triangles.
        size: Length of the longest edges in metres.
        aspect: Height of a triangle over its length.
        depth: Half extent of the places along the optical axis.

    Returns:
        The mesh; no two triangles share a corner.
    """
    random = np.random.default_rng(seed)
    axes = np.linalg.qr(random.normal(size=(count, 3, 3)))[0]
    flat = random.uniform(-1, 1, (count, 3, 2)) * [size, size * aspect]
    place = random.uniform([-0.5, -0.5, -depth], [0.5, 0.5, depth], (count, 1, 3))
    vertices = np.einsum("nka,nad->nkd", flat, axes[:, :2]) + place
    return vertices.reshape(-1, 3), np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


def folded() -> Mesh:
    """Sheet whose vertices lie in random order along x: faces of both sides on top of each other.

    Returns:
        The mesh.
    """
    vertices, faces = sheet(7)
    random = np.random.default_rng(3)
    vertices[:, 2] += random.uniform(-0.1, 0.1, len(vertices))
    return vertices + random.normal(0, 0.05, vertices.shape), faces


MESHES = {
    "ball": ball,
    "triangles everywhere": partial(random_triangles, 0, 40, 1.5, depth=4.0),
    "slivers": partial(random_triangles, 1, 60, 0.8, 1e-4),
    "needles": partial(random_triangles, 2, 60, 0.8, 1e-10),
    "smaller than a pixel": partial(random_triangles, 3, 80, 1e-3),
    "folded sheet": folded,
}
VIEWS = {
    "from afar": camera_at(),
    "close by": camera_at(0.45),
    "from within": camera_at(0.05),
    "principal point off the image": camera_at(cx=-35.3, cy=61.7),
    "principal point 2e5 pixels off": camera_at(focal=4e6, cx=-2e5, cy=0.3),
    "long focal length": camera_at(40.0, focal=1e5),
    "short focal length": camera_at(0.8, focal=0.5),
    "pixels that are not square": camera_at(fx=200.0, fy=3.0),
}
SIZES = ((1, 1), (1, 9), (17, 1), (8, 16), (33, 24))


def as_traced(mesh: Mesh, camera: Camera, jitter: float | None = None) -> Iterator[Measure]:
    """Compare what the camera sees with rays.

    Args:
        mesh: The mesh.
        camera: The camera.
        jitter: Uncertainty of image positions in pixels; by default the rounding of the largest position.

    Yields:
        Pixels with another face; errors of depths and of the points that barycentric coordinates state.
    """
    seen = compute_visibility(*mesh, camera)
    if jitter is None:
        positions = np.abs(seen.pixels[np.isfinite(seen.pixels).all(axis=1) & (seen.camera_points[:, 2] > 1e-3)])
        jitter = max(1e-6, 1e-14 * float(positions.max(initial=0)))
    expected = trace(mesh, camera, jitter)
    yield violations("pixels that show another face", (seen.face != expected.face) & expected.clear)
    fragments, hit = seen.fragments, (seen.face >= 0) & expected.clear
    depth, slack = expected.depth[hit], expected.slack[hit]
    error = np.maximum(np.abs(fragments.depth[hit] - depth) - slack, 0) / np.where(depth, depth, 1)
    yield difference("relative error of depths", error, 0.0, DEPTH)
    yield violations("depths without a face", np.isfinite(fragments.depth) != (seen.face >= 0))
    thick = slack < 1e-4 * depth  # others are seen edge-on: float32 weights do not tell a point along the ray
    corners = camera_points(mesh, camera)[mesh[1]][seen.face[hit][thick]]
    points = np.einsum("pk,pkc->pc", fragments.barycentric[hit][thick].astype(np.float64), corners)
    on_ray = pixel_rays(camera)[hit][thick] * depth[thick][:, None]
    size = np.abs(corners).max(axis=(1, 2), initial=1e-30)[:, None]
    yield difference("distance of stated points from the ray, in face sizes", (points - on_ray) / size, 0.0, 1e-3)
    yield difference("sum of weights", fragments.barycentric[hit].sum(axis=1), np.ones(int(hit.sum())), 1e-3)
    sides = (face_volumes(mesh, camera) > 0) != seen.back_facing
    yield violations("pixels whose face shows the other side", sides[seen.face[hit][thick]])


def moved_scene(scale: float, shift: float) -> Iterator[Measure]:
    """A scene of another size, far from the world's origin, with its camera.

    Args:
        scale: Factor on all lengths.
        shift: Position of scene and camera along all axes in metres.

    Yields:
        Measures of `as_traced`, and the share of pixels that show the scene.
    """
    vertices, faces = ball()
    camera = camera_at(2.0 * scale, (33, 24))
    camera_from_world = camera.camera_from_world.copy()
    camera_from_world[:3, 3] -= shift
    moved = replace(camera, camera_from_world=camera_from_world)
    rounding = 4 * np.finfo(float).eps * shift / scale  # of coordinates, in units of the scene
    yield from as_traced((vertices * scale + shift, faces), moved, jitter=1e-6 + camera.fx * rounding)
    share = float((compute_visibility(vertices * scale + shift, faces, moved).face >= 0).mean())
    yield Measure("share of pixels on the ball, difference from the disc", abs(share - 0.2), 0.1)


def one_face(depths: tuple[float, float, float]) -> Iterator[Measure]:
    """A triangle with corners at given depths, some of them behind the camera, around the optical axis.

    Args:
        depths: Depths of the corners in metres.

    Returns:
        Measures of `as_traced`.
    """
    x, y = np.array([-0.31, 0.29, 0.03]), np.array([-0.22, -0.17, 0.33])
    mesh = np.column_stack([x, y, depths]), np.array([[0, 1, 2]], np.int32)
    return as_traced(mesh, camera_at(0.0))


def covered_once(seed: int, grid: float) -> Iterator[Measure]:
    """A triangulated rectangle, drawn face by face.

    Args:
        seed: Seed of the corners.
        grid: Corners are multiples of it, in pixels; 0: anywhere.

    Yields:
        Pixels inside that are covered not exactly once, and pixels outside that are covered.
    """
    random = np.random.default_rng(seed)
    inner = random.uniform(-9.9, 9.9, (8, 2))
    inner = np.round(inner / grid) * grid if grid else inner
    pixels = np.unique(np.vstack([[[-10, -8], [10, -8], [10, 8], [-10, 8]], inner.clip([-10, -8], [10, 8])]), axis=0)
    faces = Delaunay(pixels).simplices.astype(np.int32)
    camera = camera_at(2.0, (24, 20), 64.0)  # powers of two: positions on pixel centres are exact
    vertices = np.column_stack([pixels / 32, np.zeros(len(pixels))])
    covered = sum((compute_visibility(vertices, face[None], camera).face >= 0).astype(int) for face in faces)
    expected = np.zeros((20, 24), int)
    expected[2:18, 2:22] = 1
    yield violations("pixels not covered exactly once", covered != expected)
    whole = compute_visibility(vertices, faces, camera).face >= 0
    yield violations("pixels that the whole covers but no face alone", whole != (expected > 0))


def closed_surface(seed: int, inside: bool) -> Iterator[Measure]:
    """A closed surface, drawn face by face: a ray crosses it as often from behind as from the front, or once more.

    Args:
        seed: Seed of the view.
        inside: Whether the camera is inside.

    Yields:
        Pixels in which the numbers of front and back faces do not agree with the camera's place.
    """
    random = np.random.default_rng(seed)
    vertices, faces = ball(2)
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    vertices = vertices @ turn.T + random.uniform(-0.1, 0.1, 3)
    camera = camera_at(0.02 if inside else random.uniform(0.6, 2.0), (23, 17), 20.0)
    back = face_volumes((vertices, faces), camera) > 0
    crossed = np.zeros((17, 23), int)
    for face, is_back in zip(faces, back, strict=True):
        crossed += (compute_visibility(vertices, face[None], camera).face >= 0) * (1 if is_back else -1)
    yield violations("pixels with too many or too few faces", crossed != int(inside))


def coverage(mesh: Mesh, n: int) -> Iterator[Measure]:
    """Coverage of the pixels on the outline against rays through the samples.

    Args:
        mesh: The mesh.
        n: Samples per axis.

    Yields:
        Errors of the shares beyond the samples that are not clear, and shares out of range.
    """
    camera = camera_at(2.0, (17, 12), 20.0)
    seen = compute_visibility(*mesh, camera)
    shares = seen.coverage(n)
    yield violations("shares beyond [1/n^2, 1]", ~((shares >= np.float32(1 / n**2)) & (shares <= 1)))
    off = np.pad(seen.face < 0, 1)
    h, w = seen.face.shape
    outline = (seen.face >= 0) & np.any([off[j : j + h, i : i + w] for j in range(3) for i in range(3)], axis=0)
    yield violations("shares below 1 elsewhere", (shares < 1) & ~outline)
    if n == 1:
        return
    # Faces that reach nearer than the near plane are not counted.
    counted = (camera_points(mesh, camera)[mesh[1], 2] > NEAR).all(axis=1)
    fine = trace((mesh[0], mesh[1][counted]), camera.scaled(n), jitter=1e-6)
    share, unclear = (m.reshape(h, n, w, n).mean(axis=(1, 3)) for m in (fine.face >= 0, ~fine.clear))
    # Front of several faces is also unclear where depths tie: whether any face is hit is all that counts here.
    error = np.abs(shares - np.maximum(share, 1 / n**2)) - unclear
    yield difference("error of shares", np.maximum(error, 0)[outline], 0.0, 1e-6)


def dilated_mask(size: tuple[int, int], radius: int) -> Iterator[Measure]:
    """Masks in bits against arrays: packing, complement, dilation by a disc.

    Args:
        size: Columns and rows.
        radius: Of the disc in pixels.

    Yields:
        Pixels that differ.
    """
    random = np.random.default_rng(size[0] + size[1])
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    for share in (0.0, 0.02, 1.0):
        array = random.random(size[::-1]) < share
        mask = greater(array.astype(np.float32), 0.5)
        yield violations("pixels after packing", mask.to_array() != array)
        yield violations("pixels of the complement", (~mask).to_array() == array)
        expected = cv2.dilate(array.astype(np.uint8), disc, borderType=cv2.BORDER_CONSTANT, borderValue=0) > 0
        yield violations("pixels of the dilated mask", mask.dilated(radius).to_array() != expected)


def repeated_face(count: int) -> Iterator[Measure]:
    """Faces of the same corners: the first one is seen everywhere, as it is alone.

    Args:
        count: Number of equal faces.

    Yields:
        Pixels that differ.
    """
    vertices, faces = np.array([[-0.3, -0.2, 0], [0.3, -0.25, 0.1], [0, 0.4, -0.2]]), np.array([[0, 1, 2]], np.int32)
    alone = compute_visibility(vertices, faces, camera_at())
    seen = compute_visibility(vertices, np.repeat(faces, count, axis=0), camera_at())
    yield Measure("pixels on the face, fewer than 10", float(10 - (alone.face >= 0).sum()), 0.0)
    yield violations("pixels with another face", seen.face != alone.face)
    yield difference("inverse depth", seen.inverse_depth, alone.inverse_depth, 0.0)


def turned_corners(turn: int) -> Iterator[Measure]:
    """Faces whose corners are listed in another order cover the same pixels.

    Args:
        turn: Which of the six orders.

    Yields:
        Pixels that differ.
    """
    order = ((0, 1, 2), (1, 2, 0), (2, 0, 1), (0, 2, 1), (2, 1, 0), (1, 0, 2))[turn]
    vertices, faces = random_triangles(8, 12, 0.5, depth=1.0)
    for face in faces:
        usual = compute_visibility(vertices, face[None], camera_at())
        other = compute_visibility(vertices, face[None, order], camera_at())
        yield violations("pixels", usual.face != other.face)
        yield violations("sides", (usual.back_facing != other.back_facing) != (turn > 2))


def front_and_back() -> Iterator[Measure]:
    """A face and its reverse at the same depth: the front is seen, whichever comes first.

    Yields:
        Pixels that show the back.
    """
    vertices, faces = sheet(2)
    for both, front in ((np.vstack([faces, faces[:, ::-1]]), 0), (np.vstack([faces[:, ::-1], faces]), len(faces))):
        seen = compute_visibility(vertices, both, camera_at())
        on_mesh = seen.face >= 0
        yield Measure("pixels on the sheet, fewer than 20", float(20 - on_mesh.sum()), 0.0)
        yield violations(
            "pixels that show the back", on_mesh & ((seen.face >= front + len(faces)) | (seen.face < front))
        )


def odd_corner(value: float, axis: int) -> Iterator[Measure]:
    """A triangle with a coordinate that is not finite or beyond measure, beside a ball.

    Args:
        value: The coordinate.
        axis: Which one.

    Yields:
        Pixels in which the ball is seen otherwise than alone and the triangle does not hide it; values that are not
        finite.
    """
    vertices, faces = ball()
    corners = np.array([[-3.0, -1, 3], [3, -1, 3], [0, 3, 3]])
    corners[0, axis] = value
    both = np.vstack([vertices, corners]), np.vstack([faces, [[len(vertices) + k for k in range(3)]]]).astype(np.int32)
    alone, seen = compute_visibility(vertices, faces, camera_at()), compute_visibility(*both, camera_at())
    changed = seen.face != alone.face
    yield violations("pixels that show another face of the ball", changed & (seen.face < len(faces)))
    yield violations("inverse depths that are not finite", ~np.isfinite(seen.inverse_depth))
    if not np.isfinite(value):
        yield violations("pixels that show the triangle", seen.face == len(faces))


def far_triangle(size: float, axis: int, front: bool) -> Iterator[Measure]:
    """A triangle beside the image whose image positions may exceed the range of integers, and one in the image.

    Args:
        size: Distance from the optical axis, and extent along the axis, in metres.
        axis: Horizontal (0) or vertical (1).
        front: Whether it shows its front.

    Yields:
        Measures of `as_traced`.
    """
    corners = np.array([[-0.5, -1.0, 0], [0.5, -1, 0], [0, 1.5, 0]])
    far = corners + np.array([0, 0, 0.5])
    far[:, axis] = size * np.array([1.0, 2.0, 3.0])
    order = [3, 4, 5] if front == (face_volumes((far, np.array([[0, 1, 2]])), camera_at())[0] < 0) else [3, 5, 4]
    mesh = np.vstack([corners, far]), np.array([[0, 1, 2], order], np.int32)
    yield from as_traced(mesh, camera_at(), jitter=1e-6)


if __name__ == "__main__":
    run(lambda: run_suite(__doc__, "raster", cases()))
