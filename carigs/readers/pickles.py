"""Reader of pickles that hold arrays, such as FLAME's, which runs no code of the file.

A pickle is a program for a stack machine: it names functions of any module and calls them. This reader executes the
part of that language that dictionaries of arrays need. Names are looked up in an exact table, whose entries are classes
and functions of `pickled_objects`: they record what they are given. After the program has ended, `resolve` builds the
arrays with NumPy and SciPy from checked sizes. Neither `numpy` nor `chumpy` unpickles anything.
"""

from __future__ import annotations

import io
import pickle
import pickletools
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.lib import format as npy_format

from carigs.errors import InputError
from carigs.readers.limits import read_bytes
from carigs.readers.pickled_objects import NAMES, StandIn, reconstruct, resolve

MAX_PICKLE_BYTES = 512 << 20
"""Largest pickle, in bytes; FLAME's have less than 100 MB."""
OPERATIONS = frozenset(
    """PROTO FRAME STOP MARK POP POP_MARK DUP NONE NEWTRUE NEWFALSE INT BININT BININT1 BININT2 LONG LONG1 LONG4 FLOAT
    BINFLOAT STRING BINSTRING SHORT_BINSTRING BINBYTES SHORT_BINBYTES BINBYTES8 BYTEARRAY8 UNICODE BINUNICODE
    SHORT_BINUNICODE BINUNICODE8 EMPTY_LIST APPEND APPENDS LIST EMPTY_SET ADDITEMS EMPTY_TUPLE TUPLE TUPLE1 TUPLE2
    TUPLE3 EMPTY_DICT DICT SETITEM SETITEMS GET BINGET LONG_BINGET PUT BINPUT LONG_BINPUT MEMOIZE GLOBAL
    STACK_GLOBAL REDUCE BUILD NEWOBJ""".split()
)
"""Steps of the pickle language that are executed. Sets become lists. Left out: persistent identifiers,
registered extensions, buffers outside the file, and old forms of creating objects."""


class _Unpickler(pickle._Unpickler):
    """Executes `OPERATIONS` only.

    Its base class is the implementation of `pickle.Unpickler` in Python, whose memory grows with the file alone. The
    one in C allocates what the file claims.
    """

    def find_class(self, module: str, name: str) -> Any:
        try:
            return NAMES[module, name]
        except KeyError:
            raise pickle.UnpicklingError(f"refuses to load {module[:60]}.{name[:60]}") from None

    def load_build(self) -> None:
        """Keep the state as it is, on recorded objects only: states of classes and functions would change them."""
        state = self.stack.pop()
        if not isinstance(self.stack[-1], StandIn):
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
        self.stack[-1] = reconstruct(self.stack[-1])
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
        ord(operation.code): pickle._Unpickler.dispatch[ord(operation.code)]
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
        pickle.EMPTY_SET[0]: pickle._Unpickler.load_empty_list,
        pickle.ADDITEMS[0]: load_appends,
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
    return _dictionary(read_bytes(file, MAX_PICKLE_BYTES, kind), file, kind)


def read_pickled_npy(file: str | Path, kind: str = "file") -> dict[str, Any]:
    """Read an .npy file that holds a dictionary of arrays: what `numpy.save` writes for one.

    Args:
        file: The .npy file.
        kind: What the file is, for messages.

    Returns:
        As for `read_pickle`.

    Raises:
        InputError: As for `read_pickle`, and if the file is an .npy of anything else.
    """
    stream = io.BytesIO(read_bytes(file, MAX_PICKLE_BYTES, kind))
    try:
        if npy_format.read_magic(stream) != (1, 0):
            raise ValueError("unknown version")
        shape, _, dtype = npy_format.read_array_header_1_0(stream)
    except Exception as error:  # NumPy evaluates the header as Python: many types
        raise InputError("the header of this .npy is damaged", file=file) from error
    if shape != () or dtype.kind != "O":
        raise InputError(f"holds {dtype} of shape {shape}, expected a dictionary of arrays", file=file)
    return _dictionary(stream.read(), file, kind)


def _dictionary(content: bytes, file: str | Path, kind: str) -> dict[str, Any]:
    try:
        found = resolve(_Unpickler(io.BytesIO(content), encoding="latin1").load())
        if isinstance(found, np.ndarray) and found.shape == ():
            found = found.item()
    except Exception as error:  # the program of a damaged pickle can fail in any operation
        raise InputError(f"not a {kind} of arrays ({type(error).__name__}: {str(error)[:200]})", file=file) from error
    if not isinstance(found, dict) or not all(isinstance(name, str) for name in found):
        raise InputError(f"holds a {type(found).__name__}, expected a dictionary of arrays", file=file)
    return found
