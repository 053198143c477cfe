"""Vector code of the warp: sources in the frame of eight pixels of the caricature at once, and bilinear interpolation.

LLVM makes no vector code of a loop over pixels that looks up the map of each pixel's face, and does not see that the
three channels of a sample do the same.
"""

from __future__ import annotations

from numba import types
from numba.extending import intrinsic

from carigs.simd.ir_values import DOUBLE, FLOAT, INT, LONG, generate

WIDTH = 8
OFF, BEYOND, CLOSER_LOOK, SMOOTH = 0, 1, 2, 3
"""States of a pixel: off the mesh, source outside the frame, source where surfaces meet, source within one surface."""


@intrinsic
def locate(
    typingctx, faces, place, count, x, y, maps, slope, near, height, width, tolerance, fx, fy, corner, pixel, state, at
):
    """Find the sources of the pixels (x + i, y), i < min(count, 8), of the caricature.

    All arrays are flat. Results are written to eight elements from `at` on, those of pixels off the mesh to `state`
    only.

    Args:
        typingctx: Supplied by Numba; callers leave it out.
        faces: int32 face of each pixel of the caricature, -1 where there is none.
        place: Index of the first pixel in `faces`.
        count: Number of pixels left in the row.
        x: Column of the first pixel.
        y: Row of the pixels' centres: an integer + 0.5.
        maps: float64 projective map (3, 3) of each face from pixels of the caricature to pixels of the frame.
        slope: float64 inverse depth of each face in the frame as an affine function (3) of the pixel, in 1/metres.
        near: float32 inverse depth of the frame's pixels; 0 where the 2 x 2 pixels that begin there show more than one
            surface.
        height: Rows of the frame.
        width: Columns of the frame.
        tolerance: Largest difference of depths within a surface, in metres.
        fx: float32 horizontal position of the source between the pixels of `corner`: -0.5 to 1, negative in the outer
            half of the first column.
        fy: float32 vertical position.
        corner: int32 index of the upper left one of the four pixels around the source.
        pixel: int32 index of the pixel that contains the source.
        state: int32 state of each pixel: `OFF`, `BEYOND`, `CLOSER_LOOK`, or `SMOOTH`.
        at: Index of the first pixel in the five arrays of results.

    Returns:
        None; `fx`, `fy`, `corner`, `pixel` and `state` are changed.
    """

    def build(faces, place, count, x, y, maps, slope, near, height, width, tolerance, *results_at):
        fx, fy, corner, pixel, state, at = results_at
        count, columns = count.to(INT), width.to(INT)
        face = faces.load_masked(place, count.constants(range(WIDTH)) < count, -1)
        on_mesh = face >= 0
        state.store(at, face.constants([OFF] * WIDTH))
        with x.builder.if_then(on_mesh.any()):
            px, face_index = x + x.constants(i + 0.5 for i in range(WIDTH)), face.to(LONG)

            def affine(functions, stride, k, px, py):
                """The affine function of each face's numbers k, k + 1, k + 2."""
                a, b, c = (functions.gather(face_index * stride + (k + n), on_mesh) for n in range(3))
                return a * px + (b * py + c)

            w = affine(maps, 9, 6, px, y)
            inverse = 1.0 / w
            sx, sy = affine(maps, 9, 0, px, y) * inverse, affine(maps, 9, 3, px, y) * inverse
            inside = on_mesh & (w > 0.0) & (sx >= 0.0) & (sy >= 0.0)
            inside = inside & (sx < width.to(DOUBLE)) & (sy < height.to(DOUBLE))
            u, v = ((source - 0.5).where(inside, 0.0) for source in (sx, sy))
            column, row = (t.where(t > 0.0, 0.0).to(INT) for t in (u, v))
            x0, y0 = column.to(DOUBLE), row.to(DOUBLE)
            du, dv = u - x0, v - y0
            first = row * columns + column
            inverse_depth = near.gather(first.to(LONG), inside).to(DOUBLE)
            expected = affine(slope, 3, 0, x0 + 0.5, y0 + 0.5)
            same_surface = abs(inverse_depth - expected) <= tolerance * inverse_depth * expected
            smooth = inside & same_surface & (du >= 0.0) & (dv >= 0.0)
            states = face.constants([BEYOND] * WIDTH).where(on_mesh, OFF)
            states = face.constants([CLOSER_LOOK] * WIDTH).where(inside, states)
            state.store(at, face.constants([SMOOTH] * WIDTH).where(smooth, states))
            fx.store(at, du.to(FLOAT))
            fy.store(at, dv.to(FLOAT))
            corner.store(at, first)
            right, below = (source.where(inside, 0.0).to(INT) for source in (sx, sy))
            pixel.store(at, below * columns + right)

    number, size = types.float64, types.intp
    numbers = faces, size, size, number, number, maps, slope, near, size, size, number
    return types.void(*numbers, fx, fy, corner, pixel, state, size), generate(build, contract=True)


@intrinsic
def copy_sample(typingctx, image, start, stride, fx, fy, result, place):
    """Write the sample at (fx, fy) of a block of 2 x 2 pixels to result[place : place + 3].

    Args:
        typingctx: Supplied by Numba; callers leave it out.
        image: float32 RGB image, flat. A fourth float after each pixel is read and not used.
        start: Index of the first float of the block's upper left pixel.
        stride: Length of a row of the image in floats.
        fx: Horizontal position between the pixels' centres, 0 to 1.
        fy: Vertical position, 0 to 1.
        result: float32 RGB image, flat.
        place: Index of the first float of the pixel to write.

    Returns:
        None; `result` is changed.
    """

    def build(image, start, stride, fx, fy, result, place):
        def interpolate(a, b, t):
            return a + t * (b - a)

        def row(start):
            return interpolate(image.load(start, 4), image.load(start + 3, 4), fx)

        sample = interpolate(row(start), row(start + stride), fy)
        for k in range(3):
            result.store(place + k, sample[k])

    kinds = (types.intp, types.intp, types.float32, types.float32, result, types.intp)
    return types.void(image, *kinds), generate(build, contract=True)
