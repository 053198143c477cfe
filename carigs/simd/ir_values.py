"""LLVM values with Python's operators: the language in which this project's intrinsics are written.

`generate` turns a function of such values into the code generator that `numba.extending.intrinsic` expects.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partialmethod

from llvmlite import ir
from numba import types
from numba.core import cgutils

FLOAT, DOUBLE, INT, LONG = ir.FloatType(), ir.DoubleType(), ir.IntType(32), ir.IntType(64)


class Value:
    """A number or a vector of numbers.

    Operators take vectors of one type, and numbers beside vectors. Comparisons are ordered (false with NaN) or signed,
    and give masks.
    """

    def __init__(self, builder: ir.IRBuilder, llvm: ir.Value, contract: bool = False) -> None:
        """`contract`: products and sums of floats may be fused; differences and quotients never are."""
        self.builder, self.llvm, self.contract = builder, llvm, contract
        self.width = llvm.type.count if isinstance(llvm.type, ir.VectorType) else 0
        self.element = llvm.type.element if self.width else llvm.type

    def new(self, llvm: ir.Value) -> Value:
        """Give operators to a result of the builder.

        Args:
            llvm: LLVM's value.

        Returns:
            The value, with the same builder and the same rule for fused operations as this one.
        """
        return Value(self.builder, llvm, self.contract)

    def constants(self, numbers: Iterable[float]) -> Value:
        """A constant vector of this value's element type.

        Args:
            numbers: The elements.

        Returns:
            The vector.
        """
        return self.new(constant(numbers, self.element))

    def shuffle(self, other: Value, index: Iterable[int]) -> Value:
        """Choose elements of two vectors.

        Args:
            other: The second vector.
            index: Numbers of the elements of this vector followed by those of the other one.

        Returns:
            A vector with as many elements as `index`.
        """
        return self.new(self.builder.shuffle_vector(self.llvm, other.llvm, constant(index, INT)))

    def broadcast(self, width: int) -> Value:
        """The number in all elements of a vector.

        Args:
            width: Number of elements.

        Returns:
            The vector.
        """
        undefined = ir.Constant(ir.VectorType(self.element, width), ir.Undefined)
        one = self.new(self.builder.insert_element(undefined, self.llvm, INT(0)))
        return one.shuffle(one, [0] * width)

    def where(self, mask: Value, other: Value | float) -> Value:
        """This value where the mask is set, and another elsewhere.

        Args:
            mask: Result of comparisons.
            other: Value elsewhere.

        Returns:
            The mixture.
        """
        a, b = self._pair(other)
        return self.new(self.builder.select(mask.llvm, a.llvm, b.llvm))

    def to(self, element: ir.Type) -> Value:
        """Convert to another element type; floats to integers towards zero, integers with their sign.

        Args:
            element: One of `FLOAT`, `DOUBLE`, `INT`, `LONG`.

        Returns:
            The converted value.
        """
        widens = _bits(element) > _bits(self.element)
        names = {
            (False, False): "sext" if widens else "trunc", (False, True): "sitofp",
            (True, False): "fptosi", (True, True): "fpext" if widens else "fptrunc",
        }  # fmt: skip
        convert = getattr(self.builder, names[_is_float(self.element), _is_float(element)])
        return self.new(convert(self.llvm, self._vector_of(element)))

    def bits(self, element: ir.Type) -> Value:
        """The same bits as another type of the same size.

        Args:
            element: The other element type.

        Returns:
            The reinterpreted value.
        """
        return self.new(self.builder.bitcast(self.llvm, self._vector_of(element)))

    def any(self) -> ir.Value:
        """Whether a mask is set anywhere.

        Returns:
            LLVM's truth value, as for `builder.if_then`.
        """
        whole = ir.IntType(self.width)
        return self.builder.icmp_unsigned("!=", self.builder.bitcast(self.llvm, whole), whole(0))

    def call(self, name: str, *first: ir.Value, result: ir.Type | None = None, fastmath: Iterable[str] = ()) -> Value:
        """Call one of LLVM's intrinsic functions with this value as its last argument.

        Args:
            name: Its name without `llvm.` and without the type, such as `fabs`.
            *first: Arguments before.
            result: Type of the result; that of this value if absent.
            fastmath: Flags of the call.

        Returns:
            The result.
        """
        kind = self.llvm.type
        name = f"llvm.{name}.{_type_name(kind)}"
        return self.new(_call(self.builder, name, result or kind, *first, self.llvm, fastmath=fastmath))

    def __getitem__(self, k: int) -> Value:
        return self.new(self.builder.extract_element(self.llvm, INT(k)))

    def __rtruediv__(self, other: float) -> Value:
        return self._pair(other)[1] / self

    def _pair(self, other: Value | float) -> tuple[Value, Value]:
        """Both operands with the same type."""
        if not isinstance(other, Value):
            return self, self.new(ir.Constant(self.llvm.type, [other] * self.width if self.width else other))
        if self.width == other.width:
            return self, other
        return (self, other.broadcast(self.width)) if self.width else (self.broadcast(other.width), other)

    def _binary(self, other: Value | float, name: str, fused: bool = False) -> Value:
        a, b = self._pair(other)
        if not _is_float(self.element):
            return self.new(getattr(self.builder, name)(a.llvm, b.llvm))
        flags = ("contract",) if self.contract and fused else ()
        return self.new(getattr(self.builder, f"f{name}")(a.llvm, b.llvm, flags=flags))

    def _compare(self, other: Value | float, sign: str) -> Value:
        a, b = self._pair(other)
        compare = self.builder.fcmp_ordered if _is_float(self.element) else self.builder.icmp_signed
        return self.new(compare(sign, a.llvm, b.llvm))

    def _vector_of(self, element: ir.Type) -> ir.Type:
        return ir.VectorType(element, self.width) if self.width else element

    __add__ = partialmethod(_binary, name="add", fused=True)
    __mul__ = partialmethod(_binary, name="mul", fused=True)
    __sub__ = partialmethod(_binary, name="sub")
    __truediv__ = partialmethod(_binary, name="div")
    __and__ = partialmethod(_binary, name="and_")
    __or__ = partialmethod(_binary, name="or_")
    __lshift__ = partialmethod(_binary, name="shl")
    __rshift__ = partialmethod(_binary, name="lshr")
    __lt__ = partialmethod(_compare, sign="<")
    __le__ = partialmethod(_compare, sign="<=")
    __gt__ = partialmethod(_compare, sign=">")
    __ge__ = partialmethod(_compare, sign=">=")
    __abs__ = partialmethod(call, "fabs")


class Array:
    """The data of a contiguous array, indexed flat and unchecked. Vectors are aligned as single elements are."""

    def __init__(self, builder: ir.IRBuilder, data: ir.Value, element: ir.Type, contract: bool = False) -> None:
        self.builder, self.data, self.element, self.contract = builder, data, element, contract

    def address(self, index: Value | int, kind: ir.Type | None = None) -> ir.Value:
        """Pointer to an element.

        Args:
            index: Its index.
            kind: Type that the pointer points to; the array's element type if absent.

        Returns:
            LLVM's pointer.
        """
        pointer = self.builder.gep(self.data, [LONG(index) if isinstance(index, int) else index.llvm])
        return pointer if kind is None else self.builder.bitcast(pointer, kind.as_pointer())

    def offset(self, index: Value) -> Array:
        """The array from an element on.

        Args:
            index: Index of the element.

        Returns:
            An array with the same memory.
        """
        return Array(self.builder, self.address(index), self.element, self.contract)

    def load(self, index: Value | int, width: int = 0, element: ir.Type | None = None) -> Value:
        """One element, or consecutive ones.

        Args:
            index: Index of the first.
            width: Number of elements; 0 for a number instead of a vector.
            element: Element type of the result, of the same size as the array's.

        Returns:
            The value.
        """
        element = element or self.element
        if not width:
            return self._new(self.builder.load(self.address(index)))
        address = self.address(index, ir.VectorType(element, width))
        return self._new(self.builder.load(address, align=_bits(element) // 8))

    def store(self, index: Value | int, value: Value) -> None:
        """Write one element, or consecutive ones.

        Args:
            index: Index of the first.
            value: Number or vector, of elements of the same size as the array's.
        """
        self.builder.store(value.llvm, self.address(index, value.llvm.type), align=_bits(value.element) // 8)

    def load_masked(self, index: Value, mask: Value, other: float) -> Value:
        """Consecutive elements where the mask is set; memory elsewhere is not read.

        Args:
            index: Index of the first.
            mask: Elements to read.
            other: Value of the other elements.

        Returns:
            The vector.
        """
        vector, others = ir.VectorType(self.element, mask.width), constant([other] * mask.width, self.element)
        arguments = self.address(index, vector), INT(_bits(self.element) // 8), mask.llvm, others
        return self._new(_call(self.builder, f"llvm.masked.load.{_type_name(vector)}.p0", vector, *arguments))

    def gather(self, index: Value, mask: Value) -> Value:
        """Elements at any indices where the mask is set, 0 elsewhere.

        Args:
            index: Vector of 64-bit indices.
            mask: Elements to read.

        Returns:
            The vector.
        """
        width, size = index.width, _bits(self.element) // 8
        start = self._new(self.builder.ptrtoint(self.data, LONG))
        addresses = self.builder.inttoptr((start + index * size).llvm, ir.VectorType(self.data.type, width))
        vector, zeros = ir.VectorType(self.element, width), constant([0.0] * width, self.element)
        name = f"llvm.masked.gather.{_type_name(vector)}.v{width}p0"
        return self._new(_call(self.builder, name, vector, addresses, INT(4), mask.llvm, zeros))

    def prefetch(self, index: Value, write: int) -> None:
        """Load the cache line of an element into all caches.

        Args:
            index: Index of the element.
            write: 1 if it will be written, else 0.
        """
        address = self.address(index, ir.IntType(8))
        hints = [INT(hint) for hint in (write, 3, 1)]  # locality 3: all caches; 1: data
        _call(self.builder, "llvm.prefetch.p0", ir.VoidType(), address, *hints)

    def _new(self, llvm: ir.Value) -> Value:
        return Value(self.builder, llvm, self.contract)


def generate(build: Callable, *, contract: bool = False) -> Callable:
    """The code generator of an intrinsic.

    Args:
        build: Function of the intrinsic's arguments: arrays as `Array`, tuples as lists of `Value`, others as `Value`.
            It returns a `Value`, a list of them for a tuple, or None.
        contract: Whether products and sums may be fused.

    Returns:
        The second result of a function decorated with `numba.extending.intrinsic`.
    """

    def codegen(context, builder, signature, values):
        arguments = []
        for kind, value in zip(signature.args, values, strict=True):
            if isinstance(kind, types.Array):
                data = context.make_array(kind)(context, builder, value=value).data
                arguments.append(Array(builder, data, context.get_data_type(kind.dtype), contract))
            elif isinstance(kind, types.BaseTuple):
                arguments.append([Value(builder, v, contract) for v in cgutils.unpack_tuple(builder, value)])
            else:
                arguments.append(Value(builder, value, contract))
        result = build(*arguments)
        if result is None:
            return context.get_dummy_value()
        if isinstance(result, list):
            return context.make_tuple(builder, signature.return_type, [value.llvm for value in result])
        return result.llvm

    return codegen


def constant(numbers: Iterable[float], element: ir.Type = FLOAT) -> ir.Constant:
    """A constant vector.

    Args:
        numbers: The elements.
        element: Their type.

    Returns:
        LLVM's constant.
    """
    numbers = list(numbers)
    return ir.Constant(ir.VectorType(element, len(numbers)), numbers)


def _call(builder: ir.IRBuilder, name: str, result: ir.Type, *arguments: ir.Value, fastmath: Iterable[str] = ()):
    kind = ir.FunctionType(result, [argument.type for argument in arguments])
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), arguments, fastmath=fastmath)


def _is_float(element: ir.Type) -> bool:
    return not isinstance(element, ir.IntType)


def _bits(element: ir.Type) -> int:
    return {FLOAT: 32, DOUBLE: 64}[element] if _is_float(element) else element.width


def _type_name(kind: ir.Type) -> str:
    """A type in the names of LLVM's functions: v16f32, v8i32, f64."""
    if isinstance(kind, ir.VectorType):
        return f"v{kind.count}{_type_name(kind.element)}"
    return f"{'f' if _is_float(kind) else 'i'}{_bits(kind)}"
