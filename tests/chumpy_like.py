"""A package that pickles like chumpy 0.70, and a pickler that writes what Python 2 wrote."""

from __future__ import annotations

import io
import pickle
import struct
import sys
import types
from typing import Any, ClassVar


def install(monkeypatch) -> types.SimpleNamespace:
    """Put the classes `Ch` and `Select` where chumpy has them; their states are those of chumpy's `__getstate__`."""
    state = {
        "_dirty_vars": set(), "_itr": None, "_make_dense": False, "_make_sparse": False, "_depends_on_deps": {}
    }  # fmt: skip

    class Ch:
        def __init__(self, x):
            self.x = x

        def __getstate__(self):
            return {**state, **vars(self), "_dirty_vars": {"x"}}

    class Select(Ch):
        def __init__(self, a, idxs, preferred_shape):
            self.a, self.idxs, self.preferred_shape = a, idxs, preferred_shape

    classes = {"chumpy.ch": Ch, "chumpy.reordering": Select}
    monkeypatch.setitem(sys.modules, "chumpy", types.ModuleType("chumpy"))
    for name, cls in classes.items():
        module = types.ModuleType(name)
        cls.__module__, cls.__qualname__ = name, cls.__name__
        setattr(module, cls.__name__, cls)
        monkeypatch.setitem(sys.modules, name, module)
    return types.SimpleNamespace(Ch=Ch, Select=Select)


class _Python2Pickler(pickle._Pickler):
    """Writes texts and bytes alike as Python 2's strings."""

    def _save_string(self, value: str | bytes) -> None:
        content = value.encode("latin1") if isinstance(value, str) else value
        length = struct.pack("<i", len(content))
        self.write((pickle.BINSTRING + length if len(content) > 255 else pickle.SHORT_BINSTRING + length[:1]) + content)
        self.memoize(value)

    dispatch: ClassVar[dict[type, Any]] = {**pickle._Pickler.dispatch, str: _save_string, bytes: _save_string}


def python2_pickle(value: Any) -> bytes:
    """Pickle as Python 2 did with protocol 2, with the names that NumPy and SciPy had then."""
    stream = io.BytesIO()
    _Python2Pickler(stream, 2, fix_imports=True).dump(value)
    content = stream.getvalue()
    return content.replace(b"cnumpy._core.", b"cnumpy.core.").replace(b"cscipy.sparse._csc\n", b"cscipy.sparse.csc\n")
