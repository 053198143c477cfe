"""Where eight neighbouring pixels of the caricature come from in the frame, at once, as a Numba value.

LLVM makes no vector code of a loop over pixels that looks up the map of each pixel's face.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

WIDTH = 8
OFF, BEYOND, CLOSER_LOOK, SMOOTH = 0, 1, 2, 3
"""What `locate` says of a pixel: off the mesh, from beyond the frame, at an edge of what the frame shows, or within."""

_DOUBLE, _SINGLE, _INT, _LONG = ir.DoubleType(), ir.FloatType(), ir.IntType(32), ir.IntType(64)


def _vector(kind: ir.Type) -> ir.VectorType:
    return ir.VectorType(kind, WIDTH)


def _constant(kind: ir.Type, values) -> ir.Constant:
    return ir.Constant(_vector(kind), list(values))


def _all(builder, number):
    """`number` in all elements."""
    one = builder.insert_element(ir.Constant(_vector(number.type), ir.Undefined), number, ir.Constant(_INT, 0))
    return builder.shuffle_vector(one, one, _constant(_INT, [0] * WIDTH))


def _call(builder, name, result, *values):
    kind = ir.FunctionType(result, [value.type for value in values])
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), values)


def _looked_up(builder, data, index, inside):
    """data[index] where `inside`, elsewhere 0."""
    element = data.type.pointee
    size = ir.Constant(_LONG, 4 if element == _SINGLE else 8)
    address = builder.add(_all(builder, builder.ptrtoint(data, _LONG)), builder.mul(index, _all(builder, size)))
    address = builder.inttoptr(address, ir.VectorType(data.type, WIDTH))
    nothing = _constant(element, [0.0] * WIDTH)
    name = f"llvm.masked.gather.v8f{32 if element == _SINGLE else 64}.v8p0"
    return _call(builder, name, _vector(element), address, ir.Constant(_INT, 4), inside, nothing)


@intrinsic
def locate(
    typingctx, faces, place, count, x, y, maps, slope, near, height, width, tolerance, fx, fy, corner, pixel, state, at
):
    """For i < `count` the source of the pixel (x + i, y), whose face is faces[place + i], to five arrays at `at` + i.

    `maps` holds nine numbers of each face, `slope` three, `near` the inverse depth of the frame's pixels, 0 where the
    block of four that begins there is not smooth.  `corner` is the index of the block around the source, `fx` and `fy`
    its place in it from -0.5 (beyond the first pixel's centre) to 1, `pixel` that of the pixel that holds it; `state`
    is one of the four above.  Arrays are flat, y is that of the pixel's centre, and eight elements are written.
    """

    def codegen(context, builder, signature, values):
        def data(k):
            return context.make_array(signature.args[k])(context, builder, value=values[k]).data

        def save(k, value):
            address = builder.bitcast(builder.gep(data(k), [values[16]]), value.type.as_pointer())
            builder.store(value, address, align=4)

        def plus(a, b):
            return builder.fadd(a, b, flags=("contract",))

        def times(a, b):
            return builder.fmul(a, b, flags=("contract",))

        def both(*masks):
            result = masks[0]
            for mask in masks[1:]:
                result = builder.and_(result, mask)
            return result

        steps = _constant(_INT, range(WIDTH))
        within = builder.icmp_signed("<", steps, _all(builder, builder.trunc(values[2], _INT)))
        address = builder.bitcast(builder.gep(data(0), [values[1]]), _vector(_INT).as_pointer())
        none = _constant(_INT, [-1] * WIDTH)
        face = _call(builder, "llvm.masked.load.v8i32.p0", _vector(_INT), address, ir.Constant(_INT, 4), within, none)
        on_mesh = builder.icmp_signed(">=", face, _constant(_INT, [0] * WIDTH))
        save(15, _constant(_INT, [OFF] * WIDTH))
        any_face = builder.icmp_unsigned("!=", builder.bitcast(on_mesh, ir.IntType(8)), ir.Constant(ir.IntType(8), 0))
        with builder.if_then(any_face):
            px = plus(_all(builder, values[3]), _constant(_DOUBLE, [i + 0.5 for i in range(WIDTH)]))
            py = _all(builder, values[4])
            index = builder.sext(face, _vector(_LONG))

            def plane(array, stride, k, px, py):
                """The affine function of three numbers of each face from number k on."""
                first = builder.mul(index, _constant(_LONG, [stride] * WIDTH))
                a, b, c = (
                    _looked_up(builder, array, builder.add(first, _constant(_LONG, [k + n] * WIDTH)), on_mesh)
                    for n in range(3)
                )
                return plus(times(a, px), plus(times(b, py), c))

            maps_data, half = data(5), _constant(_DOUBLE, [0.5] * WIDTH)
            zero, one = _constant(_DOUBLE, [0.0] * WIDTH), _constant(_DOUBLE, [1.0] * WIDTH)
            w = plane(maps_data, 9, 6, px, py)
            inverse = builder.fdiv(one, w)
            sx, sy = times(plane(maps_data, 9, 0, px, py), inverse), times(plane(maps_data, 9, 3, px, py), inverse)
            rows, columns = (_all(builder, builder.sitofp(values[k], _DOUBLE)) for k in (8, 9))
            inside = both(
                on_mesh,
                builder.fcmp_ordered(">", w, zero),
                builder.fcmp_ordered(">=", sx, zero),
                builder.fcmp_ordered(">=", sy, zero),
                builder.fcmp_ordered("<", sx, columns),
                builder.fcmp_ordered("<", sy, rows),
            )
            blocks = []
            for source in (sx, sy):
                moved = builder.select(inside, builder.fsub(source, half), zero)
                least = builder.select(builder.fcmp_ordered(">", moved, zero), moved, zero)
                whole = builder.fptosi(least, _vector(_INT))
                blocks.append((whole, builder.sitofp(whole, _vector(_DOUBLE)), moved))
            (i, x0, u), (j, y0, v) = blocks
            du, dv = builder.fsub(u, x0), builder.fsub(v, y0)
            corner = builder.add(builder.mul(j, _all(builder, builder.trunc(values[9], _INT))), i)
            nearness = _looked_up(builder, data(7), builder.sext(corner, _vector(_LONG)), inside)
            nearness = builder.fpext(nearness, _vector(_DOUBLE))
            expected = plane(data(6), 3, 0, plus(x0, half), plus(y0, half))
            gap = _call(builder, "llvm.fabs.v8f64", _vector(_DOUBLE), builder.fsub(nearness, expected))
            limit = times(times(_all(builder, values[10]), nearness), expected)
            plain = both(
                inside,
                builder.fcmp_ordered("<=", gap, limit),
                builder.fcmp_ordered(">=", du, zero),
                builder.fcmp_ordered(">=", dv, zero),
            )
            said = builder.select(on_mesh, _constant(_INT, [BEYOND] * WIDTH), _constant(_INT, [OFF] * WIDTH))
            said = builder.select(inside, _constant(_INT, [CLOSER_LOOK] * WIDTH), said)
            save(15, builder.select(plain, _constant(_INT, [SMOOTH] * WIDTH), said))
            save(11, builder.fptrunc(du, _vector(_SINGLE)))
            save(12, builder.fptrunc(dv, _vector(_SINGLE)))
            save(13, corner)
            right, below = (builder.fptosi(builder.select(inside, source, zero), _vector(_INT)) for source in (sx, sy))
            save(14, builder.add(builder.mul(below, _all(builder, builder.trunc(values[9], _INT))), right))
        return context.get_dummy_value()

    number, size = types.float64, types.intp
    kinds = (
        faces,
        size,
        size,
        number,
        number,
        maps,
        slope,
        near,
        size,
        size,
        number,
        fx,
        fy,
        corner,
        pixel,
        state,
        size,
    )
    return types.void(*kinds), codegen
