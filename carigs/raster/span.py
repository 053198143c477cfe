"""Eight pixels of a triangle's row at once, as one Numba value: LLVM does not find this in a loop of so few rounds.

A pixel's `key` orders what may be seen there: the inverse depth as the bits of a float (which sort as the floats do
where those are positive), then a rank that decides between equals.  0 is nothing.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

WIDTH = 8
"""Pixels that `draw` touches from `start` on: rows need as many spare keys at their end."""
_DOUBLE, _SINGLE, _SHORT, _LONG = ir.DoubleType(), ir.FloatType(), ir.IntType(32), ir.IntType(64)


def _vector(kind: ir.Type) -> ir.Type:
    return ir.VectorType(kind, WIDTH)


def _all(builder, number):
    """`number` in all elements."""
    one = builder.insert_element(ir.Constant(_vector(number.type), ir.Undefined), number, ir.Constant(_SHORT, 0))
    return builder.shuffle_vector(one, one, ir.Constant(_vector(_SHORT), [0] * WIDTH))


@intrinsic
def draw(typingctx, keys, start, count, first, slope, rank):
    """Raise keys[start + i] for i < `count` to inverse depth first + i slope and `rank`, where they are lower."""

    def codegen(context, builder, signature, values):
        array, start, count, first, slope, rank = values
        data = context.make_array(signature.args[0])(context, builder, value=array).data
        place = builder.bitcast(builder.gep(data, [start]), _vector(_LONG).as_pointer())
        steps = ir.Constant(_vector(_DOUBLE), [float(i) for i in range(WIDTH)])
        near = builder.fadd(builder.fmul(_all(builder, slope), steps), _all(builder, first))
        bits = builder.bitcast(builder.fptrunc(near, _vector(_SINGLE)), _vector(_SHORT))
        bits = builder.shl(builder.sext(bits, _vector(_LONG)), ir.Constant(_vector(_LONG), [32] * WIDTH))
        key = builder.or_(bits, _all(builder, rank))
        number = ir.Constant(_vector(_LONG), list(range(WIDTH)))
        inside = builder.icmp_signed("<", number, _all(builder, count))
        old = builder.load(place, align=8)
        higher = builder.and_(inside, builder.icmp_signed(">", key, old))
        builder.store(builder.select(higher, key, old), place, align=8)
        return context.get_dummy_value()

    return types.void(keys, types.intp, types.int64, types.float64, types.float64, types.int64), codegen
