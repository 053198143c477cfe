"""Reader of pickles that hold arrays, such as FLAME's, which runs no code of the file.

A pickle is a program for a stack machine: it names functions of any module and calls them. This reader executes the
part of that language that dictionaries of arrays need. Names are looked up in an exact table, whose entries are classes
and functions of this module: they record what they are given. After the program has ended, `_resolve` builds the arrays
with NumPy and SciPy from checked sizes. Neither `numpy` nor `chumpy` unpickles anything.

- NumPy arrays: `_reconstruct(ndarray, (0,), b"b")` with a state (version, shape, dtype, is_fortran, bytes).
- Chumpy arrays (`chumpy.Ch`, https://github.com/mattloper/chumpy): a state dictionary whose entry `x` is the array.
- SciPy's sparse matrices in the formats csc, csr and coo: a state dictionary with their arrays.
"""

from __future__ import annotations

import io
import math
import pickle
import pickletools
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from carigs.errors import InputError
from carigs.readers.limits import read_bytes
from carigs.readers.npz import KINDS, MAX_DIMENSIONS

MAX_DEPTH = 16
"""Most levels of dictionaries, lists and objects inside each other."""
MAX_PICKLE_BYTES = 512 << 20
"""Largest pickle, in bytes; FLAME's have less than 100 MB."""


class _Stub:
    """What a name of the pickle stands for: it records its arguments and its state."""

    def __init__(self, *args: Any) -> None:
        self.args, self.state = args, None


class _DataType(_Stub):
    """`numpy.dtype`: arguments (text, align, copy); the state's second entry is the byte order."""

    def resolve(self) -> np.dtype:
        name = _text(self.args[0] if self.args else "")
        dtype = np.dtype(name) if name.lstrip("<>=|")[:1] in f"{KINDS}?O" else None
        if dtype is None or dtype.kind not in f"{KINDS}O" or dtype.subdtype is not None:
            raise ValueError(f"dtype {name}")
        order = _text(self.state[1]) if isinstance(self.state, tuple) and len(self.state) > 1 else "="
        return dtype.newbyteorder(order) if order in "<>" else dtype


class _Array(_Stub):
    """`numpy.ndarray`: state (version, shape, dtype, is_fortran, bytes, or a list of objects)."""

    def resolve(self) -> np.ndarray:
        _, shape, dtype, is_fortran, content = self.state
        return _array(content, dtype.resolve(), shape, "F" if is_fortran else "C")


class _Scalar(_Stub):
    """`numpy.core.multiarray.scalar(dtype, bytes)`."""

    def resolve(self) -> np.generic:
        return _array(self.args[1], self.args[0].resolve(), (), "C")[()]


class _Buffer(_Stub):
    """`numpy.core.numeric._frombuffer(bytes, dtype, shape, order)` of protocol 5."""

    def resolve(self) -> np.ndarray:
        content, dtype, shape, order = self.args
        return _array(content, dtype.resolve(), shape, _text(order))


class _Chumpy(_Stub):
    """`chumpy.Ch`: the state's entry `x`, or the only argument, is the array."""

    def resolve(self) -> Any:
        return self.state["x"] if isinstance(self.state, dict) else self.args[0]


class _Sparse(_Stub):
    """A sparse matrix of SciPy."""

    format = ""

    def resolve(self) -> Any:
        import scipy.sparse

        state = {_text(key).lstrip("_"): value for key, value in self.state.items()}
        shape = tuple(int(n) for n in state["shape"])
        if self.format == "coo":
            row, column = (state["row"], state["col"]) if "row" in state else state["coords"]
            matrix = scipy.sparse.coo_matrix((state["data"], (row, column)), shape=shape)
            matrix._check()
            return matrix
        kind = scipy.sparse.csc_matrix if self.format == "csc" else scipy.sparse.csr_matrix
        matrix = kind((state["data"], state["indices"], state["indptr"]), shape=shape)
        matrix.check_format(full_check=True)
        return matrix


class _Csc(_Sparse):
    format = "csc"


class _Csr(_Sparse):
    format = "csr"


class _Coo(_Sparse):
    format = "coo"


class _Object(_Stub):
    """`object`, the base class that Python 2 names."""


def _reconstruct(cls: Any, *_: Any) -> _Stub:
    """`numpy.core.multiarray._reconstruct` and `copyreg._reconstructor`: an empty object of a class."""
    if not (isinstance(cls, type) and issubclass(cls, _Stub)):
        raise pickle.UnpicklingError("a class is expected")
    return cls()


def _encode(text: Any, encoding: Any = "latin1") -> bytes:
    """`_codecs.encode`: how Python 3 writes bytes for Python 2."""
    if encoding not in ("latin1", "latin-1", "utf-8"):
        raise pickle.UnpicklingError(f"encoding {str(encoding)[:20]}")
    return str(text).encode(encoding)


def _bytes(*args: Any) -> bytes:
    """`bytes()`: how Python 3 writes empty bytes for Python 2."""
    if args:
        raise pickle.UnpicklingError("bytes with arguments")
    return b""


def _table() -> dict[tuple[str, str], Callable[..., Any]]:
    table: dict[tuple[str, str], Callable[..., Any]] = {
        ("numpy", "ndarray"): _Array,
        ("numpy", "dtype"): _DataType,
        ("_codecs", "encode"): _encode,
        ("chumpy", "Ch"): _Chumpy,
        ("chumpy.ch", "Ch"): _Chumpy,
    }
    for core in ("numpy.core", "numpy._core"):
        table[f"{core}.multiarray", "_reconstruct"] = _reconstruct
        table[f"{core}.multiarray", "scalar"] = _Scalar
        table[f"{core}.numeric", "_frombuffer"] = _Buffer
    for module in ("builtins", "__builtin__"):
        table[module, "object"] = _Object
        table[module, "bytes"] = _bytes
    for module in ("copyreg", "copy_reg"):
        table[module, "_reconstructor"] = _reconstruct
    for name, stub in (("csc", _Csc), ("csr", _Csr), ("coo", _Coo)):
        for module in (f"scipy.sparse.{name}", f"scipy.sparse._{name}"):
            table[module, f"{name}_matrix"] = stub
            table[module, f"{name}_array"] = stub
    return table


NAMES = _table()
"""What a pickle may name, by module and name. There are no patterns: an allowed module also holds dangerous names."""

OPERATIONS = frozenset(
    """PROTO FRAME STOP MARK POP POP_MARK DUP NONE NEWTRUE NEWFALSE INT BININT BININT1 BININT2 LONG LONG1 LONG4 FLOAT
    BINFLOAT STRING BINSTRING SHORT_BINSTRING BINBYTES SHORT_BINBYTES BINBYTES8 BYTEARRAY8 UNICODE BINUNICODE
    SHORT_BINUNICODE BINUNICODE8 EMPTY_LIST APPEND APPENDS LIST EMPTY_TUPLE TUPLE TUPLE1 TUPLE2 TUPLE3 EMPTY_DICT DICT
    SETITEM SETITEMS GET BINGET LONG_BINGET PUT BINPUT LONG_BINPUT MEMOIZE GLOBAL STACK_GLOBAL REDUCE BUILD
    NEWOBJ""".split()
)
"""Steps of the pickle language that are executed. Left out: persistent identifiers, registered extensions, sets,
buffers outside the file, and old forms of creating objects."""


class _Unpickler(pickle._Unpickler):  # type: ignore[name-defined, misc]  # the documented class in Python, not in C
    """Executes `OPERATIONS` only.

    The Python implementation is used because its memory grows with the file alone: the one in C allocates what the
    file claims.
    """

    def find_class(self, module: str, name: str) -> Any:
        try:
            return NAMES[module, name]
        except KeyError:
            raise pickle.UnpicklingError(f"refuses to load {module[:60]}.{name[:60]}") from None

    def load_build(self) -> None:
        """Keep the state as it is, on recorded objects only: states of classes and functions would change them."""
        state = self.stack.pop()
        if not isinstance(self.stack[-1], _Stub):
            raise pickle.UnpicklingError("a state of something that is no object")
        self.stack[-1].state = state

    def load_reduce(self) -> None:
        arguments = self.stack.pop()
        function = self.stack[-1]
        if not any(function is known for known in NAMES.values()) or not isinstance(arguments, tuple):
            raise pickle.UnpicklingError("a call of something that is no function")
        self.stack[-1] = function(*arguments)

    def load_newobj(self) -> None:
        arguments = self.stack.pop()
        self.stack[-1] = _reconstruct(self.stack[-1])
        self.stack[-1].args = tuple(arguments)

    def _set_items(self, target: Any, items: list[Any]) -> None:
        # Other keys, deeply nested tuples for example, can overflow the stack of the interpreter when they are hashed.
        if not isinstance(target, dict) or any(type(key) not in (str, bytes, int) for key in items[::2]):
            raise pickle.UnpicklingError("a dictionary whose keys are not texts")
        target.update(zip(items[::2], items[1::2], strict=True))

    def load_setitem(self) -> None:
        value, key = self.stack.pop(), self.stack.pop()
        self._set_items(self.stack[-1], [key, value])

    def load_setitems(self) -> None:
        items = self.pop_mark()
        self._set_items(self.stack[-1], items)

    def load_dict(self) -> None:
        content: dict[Any, Any] = {}
        self._set_items(content, self.pop_mark())
        self.append(content)

    def load_append(self) -> None:
        value = self.stack.pop()
        self._extend([value])

    def load_appends(self) -> None:
        values = self.pop_mark()
        self._extend(values)

    def _extend(self, values: list[Any]) -> None:
        if not isinstance(self.stack[-1], list):
            raise pickle.UnpicklingError("an element of something that is no list")
        self.stack[-1].extend(values)

    dispatch: ClassVar = {
        ord(operation.code): pickle._Unpickler.dispatch[ord(operation.code)]  # type: ignore[attr-defined]
        for operation in pickletools.opcodes
        if operation.name in OPERATIONS
    } | {
        pickle.BUILD[0]: load_build,
        pickle.REDUCE[0]: load_reduce,
        pickle.NEWOBJ[0]: load_newobj,
        pickle.SETITEM[0]: load_setitem,
        pickle.SETITEMS[0]: load_setitems,
        pickle.DICT[0]: load_dict,
        pickle.APPEND[0]: load_append,
        pickle.APPENDS[0]: load_appends,
    }


def read_pickle(file: str | Path, kind: str = "pickle") -> dict[str, Any]:
    """Read a pickled dictionary of arrays.

    Args:
        file: The pickle, of any protocol, written by Python 2 or 3.
        kind: What the file is, for messages.

    Returns:
        By name NumPy arrays, sparse matrices of SciPy, numbers, texts, and lists and dictionaries of those. Chumpy
        arrays have become NumPy arrays.

    Raises:
        InputError: If the file is missing, exceeds a limit, is damaged, holds anything else than such a dictionary, or
            names something that is not in `NAMES`.
    """
    content = read_bytes(file, MAX_PICKLE_BYTES, kind)
    try:
        found = _resolve(_Unpickler(io.BytesIO(content), encoding="latin1").load(), 0, {})
    except Exception as error:  # the program of a damaged pickle can fail in any operation
        raise InputError(f"not a {kind} of arrays ({type(error).__name__}: {str(error)[:200]})", file=file) from error
    if not isinstance(found, dict) or not all(isinstance(name, str) for name in found):
        raise InputError(f"holds a {type(found).__name__}, expected a dictionary of arrays", file=file)
    return found


def _resolve(value: Any, depth: int, resolved: dict[int, tuple[Any, Any]]) -> Any:
    """Turn what the program recorded into arrays.

    `resolved` holds the results by identity: a list that contains another one ten times, which contains a third one ten
    times, and so on, would grow exponentially otherwise.
    """
    if depth > MAX_DEPTH:
        raise ValueError("nested too deeply")
    if not isinstance(value, (_Stub, dict, list, tuple, np.ndarray)):
        return value
    if id(value) not in resolved:
        resolved[id(value)] = value, _resolve_new(value, depth, resolved)  # the value too: its number stays taken
    return resolved[id(value)][1]


def _resolve_new(value: Any, depth: int, resolved: dict[int, tuple[Any, Any]]) -> Any:
    def inner(item: Any) -> Any:
        return _resolve(item, depth + 1, resolved)

    if isinstance(value, _DataType):
        return value.resolve()
    if isinstance(value, (_Array, _Scalar, _Buffer)):
        array = value.resolve()
        if array.dtype.kind != "O":
            return array
        objects = np.empty(array.size, object)
        objects[:] = [inner(item) for item in array.ravel()]
        return objects.reshape(array.shape)
    if isinstance(value, (_Chumpy, _Sparse)):
        value.state, value.args = inner(value.state), inner(value.args)
        return value.resolve()
    if isinstance(value, dict):
        return {_key(key): inner(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return type(value)(inner(item) for item in value)
    raise ValueError("an object without content")


def _key(key: Any) -> Any:
    return key.decode("latin1") if isinstance(key, bytes) else key


def _text(value: Any) -> str:
    if not isinstance(value, (str, bytes)) or len(value) > 1000:
        raise ValueError("a text is expected")
    return value.decode("latin1") if isinstance(value, bytes) else value


def _array(content: Any, dtype: np.dtype, shape: Any, order: str) -> np.ndarray:
    """An array from its bytes, or from a list of objects."""
    if not isinstance(shape, tuple) or len(shape) > MAX_DIMENSIONS or any(type(n) is not int or n < 0 for n in shape):
        raise ValueError("an impossible shape")
    count = math.prod(shape)
    if dtype.kind == "O":
        if not isinstance(content, list) or len(content) != count:
            raise ValueError("an impossible number of objects")
        array = np.empty(count, object)
        array[:] = content
    else:
        if isinstance(content, str):  # bytes of Python 2
            content = content.encode("latin1")
        if not isinstance(content, (bytes, bytearray)) or len(content) != count * dtype.itemsize or not dtype.itemsize:
            raise ValueError("an impossible number of bytes")
        array = np.frombuffer(content, dtype, count) if count else np.zeros(0, dtype)
    return array.reshape(shape, order="F" if order == "F" else "C").copy()
