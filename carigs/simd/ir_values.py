"""LLVM values with Python's operators, for intrinsics that compute on vectors of any width and element type.

Vectors of the two types of `carigs.simd.vectors` can be used anywhere in a kernel. Where one place needs others
(integers, gathers), an intrinsic is simpler: its code generator calls `operands` and writes a formula.
"""

from __future__ import annotations

from collections.abc import Iterable

from llvmlite import ir
from numba import types
from numba.core import cgutils

FLOAT, DOUBLE, INT, LONG = ir.FloatType(), ir.DoubleType(), ir.IntType(32), ir.IntType(64)


class Value:
    """A number or a vector. Operators take vectors of one type, and numbers beside vectors.

    Comparisons are ordered (false with NaN) or signed, and give masks; products and sums of floats may be fused if
    `contract` is set, differences and quotients never are.
    """

    def __init__(self, builder: ir.IRBuilder, llvm: ir.Value, contract: bool = False) -> None:
        self.builder, self.llvm, self.flags = builder, llvm, ("contract",) if contract else ()
        self.width = llvm.type.count if isinstance(llvm.type, ir.VectorType) else 0
        self.element = llvm.type.element if self.width else llvm.type
        self.is_float = isinstance(self.element, (ir.FloatType, ir.DoubleType))

    def _new(self, llvm: ir.Value) -> Value:
        return Value(self.builder, llvm, bool(self.flags))

    def broadcast(self, width: int) -> Value:
        """The number in all elements of a vector.

        Args:
            width: Number of elements.

        Returns:
            The vector.
        """
        one = self.builder.insert_element(_undefined(self.element, width), self.llvm, ir.Constant(INT, 0))
        zeros = ir.Constant(ir.VectorType(INT, width), [0] * width)
        return self._new(self.builder.shuffle_vector(one, one, zeros))

    def constants(self, numbers: Iterable[float]) -> Value:
        """A constant vector of this value's element type.

        Args:
            numbers: The elements.

        Returns:
            The vector.
        """
        return self._new(vector_constant(self.element, numbers))

    def _pair(self, other: Value | float) -> tuple[Value, Value]:
        """Both operands as LLVM values of one type."""
        if not isinstance(other, Value):
            number = [other] * self.width if self.width else other
            return self, self._new(ir.Constant(self.llvm.type, number))
        if self.width == other.width:
            return self, other
        return (self, other.broadcast(self.width)) if self.width else (self.broadcast(other.width), other)

    def _binary(self, other: Value | float, float_name: str, int_name: str, flags: tuple[str, ...] = ()) -> Value:
        a, b = self._pair(other)
        if self.is_float:
            return self._new(getattr(self.builder, float_name)(a.llvm, b.llvm, flags=flags))
        return self._new(getattr(self.builder, int_name)(a.llvm, b.llvm))

    def _compare(self, other: Value | float, sign: str) -> Value:
        a, b = self._pair(other)
        compare = self.builder.fcmp_ordered if self.is_float else self.builder.icmp_signed
        return self._new(compare(sign, a.llvm, b.llvm))

    def __add__(self, other):
        return self._binary(other, "fadd", "add", self.flags)

    def __mul__(self, other):
        return self._binary(other, "fmul", "mul", self.flags)

    def __sub__(self, other):
        return self._binary(other, "fsub", "sub")

    def __truediv__(self, other):
        return self._binary(other, "fdiv", "sdiv")

    def __rtruediv__(self, other):
        return self._pair(other)[1] / self

    def __and__(self, other):
        return self._binary(other, "", "and_")

    def __or__(self, other):
        return self._binary(other, "", "or_")

    def __lshift__(self, other):
        return self._binary(other, "", "shl")

    def __lt__(self, other):
        return self._compare(other, "<")

    def __le__(self, other):
        return self._compare(other, "<=")

    def __gt__(self, other):
        return self._compare(other, ">")

    def __ge__(self, other):
        return self._compare(other, ">=")

    def __abs__(self):
        return self.call("fabs")

    def call(self, name: str) -> Value:
        """LLVM's function of one floating-point value.

        Args:
            name: Its name without `llvm.` and without the type, such as `fabs`.

        Returns:
            A value of the same type.
        """
        return self._new(
            call_llvm(self.builder, f"llvm.{name}.{_type_name(self.llvm.type)}", self.llvm.type, self.llvm)
        )

    def where(self, mask: Value, other: Value | float) -> Value:
        """This value where the mask is set, and another elsewhere.

        Args:
            mask: Result of comparisons.
            other: Value elsewhere.

        Returns:
            The mixture.
        """
        a, b = self._pair(other)
        return self._new(self.builder.select(mask.llvm, a.llvm, b.llvm))

    def to(self, element: ir.Type) -> Value:
        """Convert to another element type; floats to integers towards zero, integers with their sign.

        Args:
            element: One of `FLOAT`, `DOUBLE`, `INT`, `LONG`.

        Returns:
            The converted value.
        """
        to_float = isinstance(element, (ir.FloatType, ir.DoubleType))
        if self.is_float != to_float:
            name = "sitofp" if to_float else "fptosi"
        else:
            wider = _bits(element) > _bits(self.element)
            name = ("fpext" if wider else "fptrunc") if to_float else ("sext" if wider else "trunc")
        return self._new(getattr(self.builder, name)(self.llvm, self._of(element)))

    def bits(self, element: ir.Type) -> Value:
        """The same bits as another type of the same size.

        Args:
            element: The other element type.

        Returns:
            The reinterpreted value.
        """
        return self._new(self.builder.bitcast(self.llvm, self._of(element)))

    def any(self) -> ir.Value:
        """Whether a mask is set anywhere.

        Returns:
            LLVM's truth value, as for `builder.if_then`.
        """
        whole = ir.IntType(self.width)
        return self.builder.icmp_unsigned("!=", self.builder.bitcast(self.llvm, whole), ir.Constant(whole, 0))

    def __getitem__(self, k: int) -> Value:
        return self._new(self.builder.extract_element(self.llvm, ir.Constant(INT, k)))

    def _of(self, element: ir.Type) -> ir.Type:
        return ir.VectorType(element, self.width) if self.width else element


class Array:
    """The data of a contiguous array, indexed flat and unchecked."""

    def __init__(self, builder: ir.IRBuilder, data: ir.Value, element: ir.Type, contract: bool = False) -> None:
        self.builder, self.data, self.element, self.contract = builder, data, element, contract

    def _address(self, index: Value, kind: ir.Type) -> ir.Value:
        return self.builder.bitcast(self.builder.gep(self.data, [index.llvm]), kind.as_pointer())

    def _new(self, llvm: ir.Value) -> Value:
        return Value(self.builder, llvm, self.contract)

    def load(self, index: Value, width: int) -> Value:
        """Consecutive elements.

        Args:
            index: Index of the first.
            width: Number of elements.

        Returns:
            The vector.
        """
        address = self._address(index, ir.VectorType(self.element, width))
        return self._new(self.builder.load(address, align=_bits(self.element) // 8))

    def store(self, index: Value, value: Value) -> None:
        """Write a number or consecutive elements.

        Args:
            index: Index of the first.
            value: Number or vector of the array's type.
        """
        self.builder.store(value.llvm, self._address(index, value.llvm.type), align=_bits(self.element) // 8)

    def load_masked(self, index: Value, mask: Value, other: float) -> Value:
        """Consecutive elements where the mask is set; memory elsewhere is not read.

        Args:
            index: Index of the first.
            mask: Elements to read.
            other: Value of the other elements.

        Returns:
            The vector.
        """
        vector = ir.VectorType(self.element, mask.width)
        name = f"llvm.masked.load.{_type_name(vector)}.p0"
        align, others = ir.Constant(INT, _bits(self.element) // 8), vector_constant(self.element, [other] * mask.width)
        return self._new(call_llvm(self.builder, name, vector, self._address(index, vector), align, mask.llvm, others))

    def gather(self, index: Value, mask: Value) -> Value:
        """Elements at any indices where the mask is set, 0 elsewhere.

        Args:
            index: Vector of 64-bit indices.
            mask: Elements to read.

        Returns:
            The vector.
        """
        size = _bits(self.element) // 8
        start = self._new(self.builder.ptrtoint(self.data, LONG))
        addresses = self.builder.inttoptr((start + index * size).llvm, ir.VectorType(self.data.type, index.width))
        vector = ir.VectorType(self.element, index.width)
        name = f"llvm.masked.gather.{_type_name(vector)}.v{index.width}p0"
        zeros = vector_constant(self.element, [0.0] * index.width)
        return self._new(call_llvm(self.builder, name, vector, addresses, ir.Constant(INT, 4), mask.llvm, zeros))


def operands(context, builder, signature, values, *, contract: bool = False) -> list[Value | Array]:
    """The arguments of an intrinsic.

    Args:
        context: First argument of a code generator of `numba.extending.intrinsic`.
        builder: Its second.
        signature: Its third.
        values: Its fourth.
        contract: Whether products and sums may be fused.

    Returns:
        Arrays as `Array`, numbers as `Value`.
    """
    result = []
    for kind, value in zip(signature.args, values, strict=True):
        if isinstance(kind, types.Array):
            data = context.make_array(kind)(context, builder, value=value).data
            result.append(Array(builder, data, context.get_data_type(kind.dtype), contract))
        else:
            result.append(Value(builder, value, contract))
    return result


def vector_constant(element: ir.Type, numbers: Iterable[float]) -> ir.Constant:
    """A constant vector.

    Args:
        element: Type of its elements.
        numbers: The elements.

    Returns:
        LLVM's constant.
    """
    numbers = list(numbers)
    return ir.Constant(ir.VectorType(element, len(numbers)), numbers)


def call_llvm(builder: ir.IRBuilder, name: str, result: ir.Type, *arguments: ir.Value, fastmath=()) -> ir.Value:
    """Call one of LLVM's intrinsic functions.

    Args:
        builder: Where the code goes.
        name: Full name, such as `llvm.sqrt.v16f32`.
        result: Type of the result.
        *arguments: LLVM values.
        fastmath: Flags of the call.

    Returns:
        The result.
    """
    kind = ir.FunctionType(result, [argument.type for argument in arguments])
    function = cgutils.get_or_insert_function(builder.module, kind, name)
    return builder.call(function, arguments, fastmath=fastmath)


def _undefined(element: ir.Type, width: int) -> ir.Constant:
    return ir.Constant(ir.VectorType(element, width), ir.Undefined)


def _bits(element: ir.Type) -> int:
    return {FLOAT: 32, DOUBLE: 64}.get(element) or element.width


def _type_name(kind: ir.Type) -> str:
    """LLVM's name of a type in the names of intrinsic functions: f64, v8f64, v8i32."""
    if isinstance(kind, ir.VectorType):
        return f"v{kind.count}{_type_name(kind.element)}"
    return f"{'i' if isinstance(kind, ir.IntType) else 'f'}{_bits(kind)}"
