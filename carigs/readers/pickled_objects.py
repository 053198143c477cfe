"""What pickles of arrays may name: stand-ins that record what they are given, and the arrays made of the records.

- NumPy arrays: `_reconstruct(ndarray, (0,), b"b")` with a state (version, shape, dtype, is_fortran, bytes).
- Chumpy arrays (https://github.com/mattloper/chumpy): a state dictionary whose entry `x` is the array (`Ch`), or whose
  entries `a`, `idxs` and `preferred_shape` are an array, indices into it and the shape of the result (`Select`).
- SciPy's sparse matrices in the formats csc, csr and coo: a state dictionary with their arrays.
- PyTorch's tensors, such as `dynamic_lmk_faces_idx` in FLAME's `landmark_embedding.npy`: not read, None.
"""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np

from carigs.readers.npz import KINDS, is_possible_shape, is_readable_text

MAX_DEPTH = 16
"""Most levels of dictionaries, lists and objects inside each other."""
MAX_ENTRIES = 1 << 26
"""Most numbers of all arrays and lists, each counted wherever it is named, and sparse matrices with their zeros."""


class StandIn:
    """Stands for a class that the pickle names: records its arguments and its state."""

    def __init__(self, *args: Any) -> None:
        self.args, self.state = args, None


class _DataType(StandIn):
    """`numpy.dtype`: arguments (text, align, copy); the state's second entry is the byte order."""

    def resolve(self) -> np.dtype:
        name = _text(self.args[0] if self.args else "")
        dtype = np.dtype(name) if name.lstrip("<>=|")[:1] in f"{KINDS}?O" else None
        if dtype is None or dtype.kind not in f"{KINDS}O" or dtype.subdtype is not None:
            raise ValueError(f"dtype {name}")
        order = _text(self.state[1]) if isinstance(self.state, tuple) and len(self.state) > 1 else "="
        return dtype.newbyteorder(order) if order in "<>" else dtype


class _Array(StandIn):
    """`numpy.ndarray`: state (version, shape, dtype, is_fortran, bytes, or a list of objects)."""

    def resolve(self) -> np.ndarray:
        _, shape, dtype, is_fortran, content = self.state
        return _array(content, dtype.resolve(), shape, "F" if is_fortran else "C")


class _Scalar(StandIn):
    """`numpy.core.multiarray.scalar(dtype, bytes)`."""

    def resolve(self) -> np.generic:
        return _array(self.args[1], self.args[0].resolve(), (), "C")[()]


class _Buffer(StandIn):
    """`numpy.core.numeric._frombuffer(bytes, dtype, shape, order)` of protocol 5."""

    def resolve(self) -> np.ndarray:
        content, dtype, shape, order = self.args
        return _array(content, dtype.resolve(), shape, _text(order))


class _Chumpy(StandIn):
    """`chumpy.Ch`: the state's entry `x`, or the only argument, is the array."""

    def resolve(self) -> Any:
        return self.state["x"] if isinstance(self.state, dict) else self.args[0]


class _ChumpySelect(StandIn):
    """`chumpy.reordering.Select`: a part of an array, such as some of its columns."""

    def resolve(self) -> np.ndarray:
        return np.asarray(self.state["a"]).reshape(-1)[self.state["idxs"]].reshape(self.state["preferred_shape"])


class _Sparse(StandIn):
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


class _Unread(StandIn):
    """Parts of a tensor of PyTorch: a storage pickled on its own, its view, and a dictionary of hooks."""

    def resolve(self) -> None:
        return None


class _Object(StandIn):
    """`object`, the base class that Python 2 names."""


def reconstruct(cls: Any, *_: Any) -> StandIn:
    """`numpy.core.multiarray._reconstruct` and `copyreg._reconstructor`: an empty object of a class.

    Args:
        cls: One of the stand-ins.

    Returns:
        An object of it.

    Raises:
        UnpicklingError: If it is anything else.
    """
    if not (isinstance(cls, type) and issubclass(cls, StandIn)):
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


def _set(items: Any = ()) -> list[Any]:
    """`set(list)`: a set, whose content is read as a list."""
    if not isinstance(items, (list, tuple)):
        raise pickle.UnpicklingError("a list is expected")
    return list(items)


def _table() -> dict[tuple[str, str], Callable[..., Any]]:
    table: dict[tuple[str, str], Callable[..., Any]] = {
        ("numpy", "ndarray"): _Array,
        ("numpy", "dtype"): _DataType,
        ("_codecs", "encode"): _encode,
        ("chumpy", "Ch"): _Chumpy,
        ("chumpy.ch", "Ch"): _Chumpy,
        ("chumpy.reordering", "Select"): _ChumpySelect,
        ("torch._utils", "_rebuild_tensor_v2"): _Unread,
        ("torch.storage", "_load_from_bytes"): _Unread,
        ("collections", "OrderedDict"): _Unread,
    }
    for core in ("numpy.core", "numpy._core"):
        table[f"{core}.multiarray", "_reconstruct"] = reconstruct
        table[f"{core}.multiarray", "scalar"] = _Scalar
        table[f"{core}.numeric", "_frombuffer"] = _Buffer
    for module in ("builtins", "__builtin__"):
        table[module, "object"] = _Object
        table[module, "bytes"] = _bytes
        table[module, "set"] = _set
    for module in ("copyreg", "copy_reg"):
        table[module, "_reconstructor"] = reconstruct
    for name, stub in (("csc", _Csc), ("csr", _Csr), ("coo", _Coo)):
        for module in (f"scipy.sparse.{name}", f"scipy.sparse._{name}"):
            table[module, f"{name}_matrix"] = stub
            table[module, f"{name}_array"] = stub
    return table


NAMES = _table()
"""What a pickle may name, by module and name. There are no patterns: an allowed module also holds dangerous names."""


def resolve(recorded: Any) -> Any:
    """Turn what the program of a pickle recorded into arrays.

    Args:
        recorded: The result of the program.

    Returns:
        The same with NumPy arrays, numbers and SciPy's sparse matrices in place of the stand-ins.

    Raises:
        ValueError: The content contradicts itself or is nested too deeply.
        Exception: Errors of other types, where a stand-in was given something else than its class expects.
    """
    return _resolve(recorded, 0, {})[0]


def _resolve(value: Any, depth: int, resolved: dict[int, tuple[Any, Any, int]]) -> tuple[Any, int]:
    """Turn what the program recorded into arrays; with the number of their entries.

    `resolved` holds the results by identity: a list that contains another one ten times, which contains a third one ten
    times, and so on, would take exponential time otherwise. The number of entries is limited because whoever makes an
    array of such a list, or of a sparse matrix, allocates each of them.
    """
    if depth > MAX_DEPTH:
        raise ValueError("nested too deeply")
    if not isinstance(value, (StandIn, dict, list, tuple)):
        return value, 1
    if id(value) not in resolved:
        entries = 0

        def count(size: int) -> None:
            nonlocal entries
            entries += size
            if entries > MAX_ENTRIES:
                raise ValueError(f"more than {MAX_ENTRIES} entries")

        def inner(item: Any) -> Any:
            result, size = _resolve(item, depth + 1, resolved)
            count(size)
            return result

        result = _resolved(value, inner)
        count(math.prod(getattr(result, "shape", ())))
        resolved[id(value)] = value, result, entries  # the value too: its number stays taken
    return resolved[id(value)][1:]


def _resolved(value: Any, inner: Callable[[Any], Any]) -> Any:
    """What a recorded object stands for; `inner` resolves what it contains."""
    if isinstance(value, _DataType):
        return value.resolve()
    if isinstance(value, (_Array, _Scalar, _Buffer)):
        array = value.resolve()
        if array.dtype.kind != "O":
            return array
        return np.fromiter(map(inner, array.ravel()), object, array.size).reshape(array.shape)
    if isinstance(value, (_Chumpy, _ChumpySelect, _Sparse, _Unread)):
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
    if not isinstance(shape, tuple) or not is_possible_shape(shape):
        raise ValueError("an impossible shape")
    count = math.prod(shape)
    if dtype.kind == "O":
        if not isinstance(content, list) or len(content) != count:
            raise ValueError("an impossible number of objects")
        array = np.fromiter(content, object, count)
    else:
        if isinstance(content, str):  # bytes of Python 2
            content = content.encode("latin1")
        if not isinstance(content, (bytes, bytearray)) or len(content) != count * dtype.itemsize or not dtype.itemsize:
            raise ValueError("an impossible number of bytes")
        array = np.frombuffer(content, dtype, count) if count else np.zeros(0, dtype)
        if not is_readable_text(array):
            raise ValueError("a text with a character that does not exist")
    return array.reshape(shape, order="F" if order == "F" else "C").copy()
