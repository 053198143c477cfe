"""Between memory and the vectors of `simd`: rows, blocks, fields of records, transposes, prefetching, a counter.

All functions take flat arrays and check nothing: an array that is stored to needs as many spare elements at its end as
the last store may overhang.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from carigs.simd.vectors import FLOAT, INT, WIDTH, call, lanes, shuffle

_VECTOR, _QUAD = lanes.llvm, ir.VectorType(FLOAT, 4)


def _address(context, builder, signature, values):
    data = context.make_array(signature.args[0])(context, builder, value=values[0]).data
    return builder.gep(data, [values[1]])


def _load(builder, address, kind=_VECTOR):
    return builder.load(builder.bitcast(address, kind.as_pointer()), align=4)


def _store(builder, value, address):
    builder.store(value, builder.bitcast(address, value.type.as_pointer()), align=4)


def _offset(builder, address, elements):
    """`address` of 4-byte elements, further on."""
    return builder.gep(address, [ir.Constant(ir.IntType(64), elements)])


@intrinsic
def align_stack(typingctx):
    """Aligns the calling kernel's stack to 64 bytes, which LLVM then does, and only then.

    Otherwise vectors that do not fit into registers lie across two cache lines in three processes out of four.
    """

    def codegen(context, builder, signature, values):
        slot = cgutils.alloca_once(builder, _VECTOR)
        slot.align = 64
        # No instruction at all, but LLVM does not know.
        builder.asm(ir.FunctionType(ir.VoidType(), [slot.type]), "", "r", [slot], side_effect=True)
        return context.get_dummy_value()

    return types.void(), codegen


@intrinsic
def load(typingctx, array, index):
    """Sixteen consecutive elements."""

    def codegen(context, builder, signature, values):
        return _load(builder, _address(context, builder, signature, values))

    return lanes(array, types.intp), codegen


@intrinsic
def store(typingctx, array, index, value):
    """To sixteen consecutive elements (of any type of four bytes)."""

    def codegen(context, builder, signature, values):
        _store(builder, values[2], _address(context, builder, signature, values))
        return context.get_dummy_value()

    return types.void(array, types.intp, lanes), codegen


# Between four rows of four (memory) and lanes (columns first): its own inverse.
_TRANSPOSE = [4 * (i % 4) + i // 4 for i in range(WIDTH)]


@intrinsic
def load_block(typingctx, array, index, stride):
    """A block of 4 x 4 pixels from four rows of an image."""

    def codegen(context, builder, signature, values):
        quads = []
        for _ in range(4):
            quads.append(_load(builder, _address(context, builder, signature, values), _QUAD))
            values = (values[0], builder.add(values[1], values[2]), values[2])
        top, bottom = (shuffle(builder, quads[i], quads[i + 1], range(8)) for i in (0, 2))
        both = shuffle(builder, top, bottom, range(WIDTH))
        return shuffle(builder, both, both, _TRANSPOSE)

    return lanes(array, types.intp, types.intp), codegen


@intrinsic
def store_block(typingctx, array, index, stride, value):
    """A block of 4 x 4 pixels to four rows of an image."""

    def codegen(context, builder, signature, values):
        array, index, stride, value = values
        by_rows = shuffle(builder, value, value, _TRANSPOSE)
        for row in range(4):
            quad = shuffle(builder, by_rows, by_rows, range(4 * row, 4 * row + 4))
            _store(builder, quad, _address(context, builder, signature, (array, index)))
            index = builder.add(index, stride)
        return context.get_dummy_value()

    return types.void(array, types.intp, types.intp, lanes), codegen


def _load_fields(count):
    """Sixteen records of `count` floats, one after the other, as lanes of each field."""

    @intrinsic
    def function(typingctx, array, index):
        def codegen(context, builder, signature, values):
            start = _address(context, builder, signature, values)
            memory = [_load(builder, _offset(builder, start, WIDTH * j)) for j in range(count)]
            fields = []
            for k in range(count):
                at = [count * i + k for i in range(WIDTH)]  # where lane i lies in memory
                field = memory[0]
                for j in range(1, count):
                    own = [a - WIDTH * (j - 1) if a < WIDTH else 0 for a in at] if j == 1 else range(WIDTH)
                    index = [WIDTH + a % WIDTH if a // WIDTH == j else o for a, o in zip(at, own, strict=True)]
                    field = shuffle(builder, field, memory[j], index)
                fields.append(field)
            return context.make_tuple(builder, signature.return_type, fields)

        return types.UniTuple(lanes, count)(array, types.intp), codegen

    return function


load2, load3, load4, load9 = _load_fields(2), _load_fields(3), _load_fields(4), _load_fields(9)


def _store_fields(count):
    """Lanes of each field to sixteen records of `count` elements, one after the other."""

    @intrinsic
    def function(typingctx, array, index, fields):
        def codegen(context, builder, signature, values):
            start = _address(context, builder, signature, values)
            fields = cgutils.unpack_tuple(builder, values[2], count)
            for j in range(count):
                at = [divmod(WIDTH * j + e, count) for e in range(WIDTH)]  # record and field of each element
                value = fields[0]
                for k in range(1, count):
                    own = [record for record, _ in at] if k == 1 else range(WIDTH)
                    index = [WIDTH + record if field == k else o for (record, field), o in zip(at, own, strict=True)]
                    value = shuffle(builder, value, fields[k], index)
                _store(builder, value, _offset(builder, start, WIDTH * j))
            return context.get_dummy_value()

        return types.void(array, types.intp, types.UniTuple(lanes, count)), codegen

    return function


store2, store3, store4, store9 = _store_fields(2), _store_fields(3), _store_fields(4), _store_fields(9)


def _transposed(builder, rows):
    """Sixteen vectors with rows and columns exchanged: four rounds of 2 x 2 blocks."""
    rows = list(rows)
    for half in (8, 4, 2, 1):
        low = [WIDTH + (e ^ half) if e & half else e for e in range(WIDTH)]
        high = [WIDTH + e if e & half else e | half for e in range(WIDTH)]
        for i in range(WIDTH):
            if not i & half:
                a, b = rows[i], rows[i | half]
                rows[i], rows[i | half] = shuffle(builder, a, b, low), shuffle(builder, a, b, high)
    return rows


_SIXTEEN = types.UniTuple(lanes, WIDTH)


@intrinsic
def load_rows(typingctx, array, index, stride):
    """Sixteen floats from each of sixteen rows `stride` apart, as lanes of each column."""

    def codegen(context, builder, signature, values):
        array, index, stride = values
        rows = []
        for _ in range(WIDTH):
            rows.append(_load(builder, _address(context, builder, signature, (array, index))))
            index = builder.add(index, stride)
        return context.make_tuple(builder, signature.return_type, _transposed(builder, rows))

    return _SIXTEEN(array, types.intp, types.intp), codegen


@intrinsic
def gather_rows(typingctx, array, chosen, index, stride, column):
    """Sixteen floats from `column` on of the rows `chosen[index]`, `chosen[index + 1]`, .., as lanes of each column."""

    def codegen(context, builder, signature, values):
        array, chosen, index, stride, column = values
        numbers = context.make_array(signature.args[1])(context, builder, value=chosen).data
        rows = []
        for r in range(WIDTH):
            row = builder.load(builder.gep(numbers, [builder.add(index, ir.Constant(index.type, r))]))
            at = builder.add(builder.mul(builder.sext(row, stride.type), stride), column)
            rows.append(_load(builder, _address(context, builder, signature, (array, at))))
        return context.make_tuple(builder, signature.return_type, _transposed(builder, rows))

    return _SIXTEEN(array, chosen, types.intp, types.intp, types.intp), codegen


@intrinsic
def store_rows(typingctx, array, index, stride, columns):
    """The inverse of `load_rows`."""

    def codegen(context, builder, signature, values):
        array, index, stride, columns = values
        for row in _transposed(builder, cgutils.unpack_tuple(builder, columns, WIDTH)):
            _store(builder, row, _address(context, builder, signature, (array, index)))
            index = builder.add(index, stride)
        return context.get_dummy_value()

    return types.void(array, types.intp, types.intp, _SIXTEEN), codegen


@intrinsic
def load_scalar(typingctx, array, index):
    """array[index] of a flat array without Python's treatment of negative indices."""

    def codegen(context, builder, signature, values):
        return builder.load(_address(context, builder, signature, values))

    return array.dtype(array, types.intp), codegen


@intrinsic
def store_scalar(typingctx, array, index, value):
    """array[index] = value, likewise."""

    def codegen(context, builder, signature, values):
        builder.store(values[2], _address(context, builder, signature, values))
        return context.get_dummy_value()

    return types.void(array, types.intp, array.dtype), codegen


def _prefetch(write):
    @intrinsic
    def function(typingctx, array, index):
        def codegen(context, builder, signature, values):
            byte = ir.IntType(8).as_pointer()
            address = builder.bitcast(_address(context, builder, signature, values), byte)
            hints = [ir.Constant(INT, hint) for hint in (write, 3, 1)]  # locality 3: all caches; 1: data
            call(builder, "llvm.prefetch.p0", ir.VoidType(), address, *hints)
            return context.get_dummy_value()

        return types.void(array, types.intp), codegen

    return function


prefetch, prefetch_to_write = _prefetch(0), _prefetch(1)


@intrinsic
def atomic_add(typingctx, counter, index):
    """counter[index], which is increased by one for the next to ask: atomic."""

    def codegen(context, builder, signature, values):
        address = _address(context, builder, signature, values)
        one = ir.Constant(ir.IntType(64), 1)
        return builder.atomic_rmw("add", address, one, "monotonic")

    return types.int64(counter, types.intp), codegen
