"""A bilinear sample of three channels at once, as a Numba value: LLVM does not see that the channels do the same."""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

_FLOAT, _INT, _LONG = ir.FloatType(), ir.IntType(32), ir.IntType(64)
_FOUR = ir.VectorType(_FLOAT, 4)


@intrinsic
def copy_sample(typingctx, image, start, stride, fx, fy, result, place):
    """result[place : place + 3] = the sample at (fx, fy) in the block of four pixels that begins at image[start].

    Both arrays are flat, `stride` is a row's length; a fourth float after each pixel is read and not used.
    """

    def codegen(context, builder, signature, values):
        image, start, stride, fx, fy, result, place = values
        data = context.make_array(signature.args[0])(context, builder, value=image).data
        there = context.make_array(signature.args[5])(context, builder, value=result).data

        def load(offset):
            address = builder.bitcast(builder.gep(data, [offset]), _FOUR.as_pointer())
            return builder.load(address, align=4)

        def spread(number):
            one = builder.insert_element(ir.Constant(_FOUR, ir.Undefined), number, ir.Constant(_INT, 0))
            return builder.shuffle_vector(one, one, ir.Constant(ir.VectorType(_INT, 4), [0] * 4))

        def between(a, b, share):
            flags = ("contract",)
            return builder.fadd(a, builder.fmul(share, builder.fsub(b, a), flags=flags), flags=flags)

        three, fx, fy = ir.Constant(_LONG, 3), spread(fx), spread(fy)
        below = builder.add(start, stride)
        upper = between(load(start), load(builder.add(start, three)), fx)
        lower = between(load(below), load(builder.add(below, three)), fx)
        mean = between(upper, lower, fy)
        for k in range(3):
            number = builder.extract_element(mean, ir.Constant(_INT, k))
            builder.store(number, builder.gep(there, [builder.add(place, ir.Constant(_LONG, k))]))
        return context.get_dummy_value()

    kinds = (types.intp, types.intp, types.float32, types.float32, result, types.intp)
    return types.void(image, *kinds), codegen
