"""Pickles that would run code when they are loaded, and broken ones."""

from __future__ import annotations

import io
import pickle
import zipfile
from collections.abc import Iterator, Mapping

import scipy.sparse

from stress.hostile_cases.case import Case

NAMES = (
    "os system", "posix system", "subprocess getoutput", "builtins eval", "builtins exec", "builtins open",
    "builtins getattr", "builtins __import__", "numpy load", "numpy fromfile", "numpy savetxt", "numpy memmap",
    "numpy.testing runstring", "numpy.testing measure", "numpy.testing._private.utils os.system",
    "numpy ndarray.tofile", "numpy.core.multiarray fromfile", "numpy.ctypeslib load_library", "pickle loads",
    "torch load", "shutil rmtree", "pathlib Path.touch", "importlib import_module", "operator attrgetter",
    "functools partial", "types FunctionType", "codecs open", "ctypes CDLL", "timeit timeit", "runpy run_path",
    "copyreg __newobj__", "scipy.io loadmat", "scipy.sparse load_npz", "chumpy.ch Ch.__init__", "_codecs lookup",
    "builtins bytes.fromhex", "carigs.readers.pickles read_pickle",
)  # fmt: skip


def payloads(sound: Mapping[str, bytes]) -> Iterator[Case]:
    """Pickles that call functions, by each way that a pickle has, alone and inside other formats.

    Args:
        sound: Content of a sound file of each reader.

    Yields:
        The cases.
    """
    for names in NAMES:
        module, name = names.split()
        argument = b"import os;os.system('touch ran')" if "run" in name or "e" in name[:2] else b"touch ran"
        texts = b"".join(b"\x8c" + bytes([len(text)]) + text.encode() for text in (module, name))
        named = b"\x8c" + bytes([len(argument)]) + argument
        programs = {
            "GLOBAL": f"c{module}\n{name}\n(S'".encode() + argument.replace(b"'", b'"') + b"'\ntR.",
            "STACK_GLOBAL": b"\x80\x04" + texts + b"\x93" + named + b"\x85R.",
            "INST": b"(S'" + argument.replace(b"'", b'"') + f"'\ni{module}\n{name}\n.".encode(),
            "NEWOBJ": b"\x80\x04" + texts + b"\x93" + named + b"\x85\x81.",
            "BUILD": b"\x80\x04" + texts + b"\x93}\x8c\x01x" + named + b"sb.",
        }
        for form, program in programs.items():
            yield Case(f"{form} {module}.{name}", "pickle", program, must_fail=True)
        inside = b"\x80\x04}\x8c\x01a" + programs["STACK_GLOBAL"][2:-1] + b"s."
        yield Case(f"in FLAME: {module}.{name}", "flame", inside, must_fail=True)
        header = sound["pickled npy"][: sound["pickled npy"].index(b"\n") + 1]
        yield Case(f"in .npy: {module}.{name}", "pickled npy", header + inside, must_fail=True)
        stream = io.BytesIO()
        with zipfile.ZipFile(io.BytesIO(sound["pt"])) as archive, zipfile.ZipFile(stream, "w") as changed:
            for member in archive.namelist():
                changed.writestr(member, inside if member.endswith("data.pkl") else archive.read(member))
        yield Case(f"in torch.save: {module}.{name}", "pt", stream.getvalue(), must_fail=True)
        yield Case(f"legacy torch.save: {module}.{name}", "legacy", inside, must_fail=True)


def expanding_pickles() -> Iterator[Case]:
    """Small pickles that grow when arrays are made of them: lists that share each other, and sparse matrices.

    Yields:
        The cases.
    """
    value: list = [0.0]
    for _ in range(14):
        value = [value] * 100
    matrix = scipy.sparse.csc_matrix((2**40, 1))
    small = scipy.sparse.csc_matrix((10**6, 5))
    for name, content in (
        ("lists of lists", {"v_template": value}),
        ("a sparse matrix", {"J_regressor": matrix}),
        ("100 names of a sparse matrix", {f"v{k}": small for k in range(100)}),
    ):
        yield Case(name, "flame", pickle.dumps(content), must_fail=True)


def broken_pickles() -> Iterator[Case]:
    """Pickles that claim sizes, nest deeply, or hold what no reader expects.

    Yields:
        The cases.
    """
    for program in (
        b"\x80\x02r\xff\xff\xff\xffN.", b"\x80\x04)" + b"\x85" * 300_000 + b".", b"\x80\x04\x8e" + b"\xff" * 8 + b".",
        b"\x80\x04}(" + b")" + b"\x85" * 300_000 + b"K\x01u.", b"(" * 10**6 + b".", b"\x80\x02]" + b"2a" * 30 + b".",
        pickle.dumps([1]), pickle.dumps({1: 2}), pickle.dumps({"a": frozenset()}),
        pickle.dumps({"a": 1j}), b".", b"I1\n.",
    ):  # fmt: skip
        yield Case(repr(program[:20]), "pickle", program, must_fail=True)
