"""Pickles: arrays of all generations of writers are read, and no code of the file runs."""

from __future__ import annotations

import copyreg
import pickle

import numpy as np
import pytest
import scipy.sparse
from chumpy_like import install

from carigs.errors import InputError
from carigs.readers.pickled_objects import NAMES
from carigs.readers.pickles import read_pickle, read_pickled_npy


@pytest.fixture
def chumpy(monkeypatch):
    """Stands for the package chumpy, which need not be installed."""
    return install(monkeypatch)


@pytest.mark.parametrize("protocol", range(6))
def test_arrays_of_every_protocol_come_back(protocol, tmp_path):
    rng = np.random.default_rng(protocol)
    content = {
        "float": rng.normal(size=(4, 3)),
        "fortran": np.asfortranarray(rng.normal(size=(2, 3, 4)).astype(np.float32)),
        "big endian": np.arange(5, dtype=">i4"),
        "empty": np.zeros((0, 3)),
        "objects": np.array([{"ids": np.arange(3)}, None], object),
        "arrays": np.fromiter([np.arange(2), np.arange(2, 4)], object, 2),
        "bool": np.array([True, False]),
        "list": [1, 2.5, "three", np.arange(2)],
        "scalar": np.float64(0.5),
    }
    (tmp_path / "a.pkl").write_bytes(pickle.dumps(content, protocol))
    found = read_pickle(tmp_path / "a.pkl")
    assert list(found) == list(content)
    for name in ("float", "fortran", "big endian", "empty", "bool"):
        assert found[name].dtype.newbyteorder("=") == content[name].dtype.newbyteorder("=")
        np.testing.assert_array_equal(found[name], content[name])
    np.testing.assert_array_equal(found["objects"][0]["ids"], [0, 1, 2])
    assert found["objects"][1] is None
    assert found["arrays"].shape == (2,) and found["arrays"][1].tolist() == [2, 3]
    assert found["list"][:3] == [1, 2.5, "three"]
    assert found["scalar"] == 0.5


@pytest.mark.parametrize("protocol", range(6))
@pytest.mark.parametrize("kind", ["csc", "csr", "coo"])
def test_sparse_matrices_come_back(protocol, kind, tmp_path):
    matrix = scipy.sparse.random(5, 9, 0.3, kind, rng=np.random.default_rng(3))
    (tmp_path / "a.pkl").write_bytes(pickle.dumps({"J_regressor": matrix}, protocol))
    np.testing.assert_array_equal(read_pickle(tmp_path / "a.pkl")["J_regressor"].toarray(), matrix.toarray())


def test_a_sparse_matrix_with_indices_out_of_range_is_refused(tmp_path):
    matrix = scipy.sparse.csc_matrix(np.eye(3))
    matrix.indices[1] = 1_000_000
    (tmp_path / "a.pkl").write_bytes(pickle.dumps({"J_regressor": matrix}))
    with pytest.raises(InputError):
        read_pickle(tmp_path / "a.pkl")


@pytest.mark.parametrize("protocol", range(6))
def test_chumpy_arrays_are_read_without_chumpy(protocol, chumpy, tmp_path):
    """Chumpy writes an empty object and its state (NEWOBJ or `copy_reg._reconstructor`, then BUILD)."""
    array = np.random.default_rng(1).normal(size=(3, 2))
    content = {"shapedirs": chumpy.Ch(array), "columns": chumpy.Select(chumpy.Ch(array), np.array([0, 2, 4]), (3, 1))}
    (tmp_path / "a.pkl").write_bytes(pickle.dumps(content, protocol))
    found = read_pickle(tmp_path / "a.pkl")
    np.testing.assert_array_equal(found["shapedirs"], array)
    np.testing.assert_array_equal(found["columns"], array[:, :1])


@pytest.mark.parametrize("protocol", range(6))
def test_sets_are_read_as_lists(protocol, tmp_path):
    (tmp_path / "a.pkl").write_bytes(pickle.dumps({"names": {"a", "b"}, "none": set()}, protocol))
    found = read_pickle(tmp_path / "a.pkl")
    assert sorted(found["names"]) == ["a", "b"] and found["none"] == []


@pytest.mark.parametrize("protocol", range(6))
def test_tensors_are_left_out(protocol, tmp_path):
    """FLAME's `landmark_embedding.npy` holds some beside its arrays."""
    torch = pytest.importorskip("torch")
    content = {"static": np.arange(3), "dynamic": torch.arange(6).reshape(2, 3), "last": 1}
    (tmp_path / "a.pkl").write_bytes(pickle.dumps(content, protocol))
    found = read_pickle(tmp_path / "a.pkl")
    np.testing.assert_array_equal(found["static"], [0, 1, 2])
    assert found["dynamic"] is None and found["last"] == 1


def test_pickled_npy_files_are_read(tmp_path):
    np.save(tmp_path / "a.npy", {"ids": np.arange(3)})
    np.testing.assert_array_equal(read_pickled_npy(tmp_path / "a.npy")["ids"], [0, 1, 2])


@pytest.mark.parametrize("content", [np.zeros(3), np.array([{"ids": 1}], object), np.array({1: 2}, object)])
def test_npy_files_of_anything_else_are_refused(content, tmp_path):
    np.save(tmp_path / "a.npy", content)
    with pytest.raises(InputError, match=r"a\.npy: "):
        read_pickled_npy(tmp_path / "a.npy")


def test_npy_files_run_no_code(tmp_path, monkeypatch):
    ran = []
    monkeypatch.setattr("os.system", ran.append)
    np.save(tmp_path / "a.npy", {"ids": 1})
    header = (tmp_path / "a.npy").read_bytes()[:128]
    (tmp_path / "a.npy").write_bytes(header + HOSTILE["os.system"])
    with pytest.raises(InputError, match="refuses to load"):
        read_pickled_npy(tmp_path / "a.npy")
    assert not ran


class _Call:
    def __init__(self, function, *args):
        self.call = function, args

    def __reduce__(self):
        return self.call


def _text_global(module: str, name: str, argument: bytes) -> bytes:
    return f"c{module}\n{name}\n".encode() + argument + b"\x85R."


def _stack_global(module: str, name: str) -> bytes:
    texts = b"".join(b"\x8c" + bytes([len(text)]) + text.encode() for text in (module, name))
    return b"\x80\x04" + texts + b"\x93\x8c\x04true\x85R."


HOSTILE = {
    "dotted name": _stack_global("numpy.testing._private.utils", "os.system"),
    "os.system": _text_global("os", "system", b"S'true'\n"),
    "runstring": _stack_global("numpy.testing", "runstring"),
    "measure": _stack_global("numpy.testing", "measure"),
    "numpy.load": _stack_global("numpy", "load"),
    "numpy.savetxt": _stack_global("numpy", "savetxt"),
    "numpy.core.multiarray.fromfile": _stack_global("numpy.core.multiarray", "fromfile"),
    "dotted ndarray": _stack_global("numpy", "ndarray.tofile"),
    "import": _stack_global("builtins", "__import__"),
    "eval": _stack_global("builtins", "eval"),
    "getattr": _text_global("__builtin__", "getattr", b"S'x'\n"),
    "collections": _stack_global("collections", "abc.sys.modules"),
    "codecs": _stack_global("_codecs", "lookup"),
    "scipy": _stack_global("scipy.sparse._base", "np.load"),
    "chumpy": _stack_global("chumpy.ch", "pickle.loads"),
    "instance": b"(S'true'\nios\nsystem\n.",
    "object": b"(cos\nsystem\nS'true'\no.",
    "extension": b"\x82\x01.",
    "persistent": b"Psomething\n.",
    "state of a class": b"\x80\x02cnumpy\ndtype\n}U\x08__init__K\x01sb.",
    "state of a function": b"\x80\x02c_codecs\nencode\n}U\x0c__defaults__K\x01sb.",
    "call of a text": b"\x80\x02U\x04true)R.",
    "list as class": b"\x80\x02])\x81.",
    "set of a text": b"\x80\x02c__builtin__\nset\nU\x04true\x85R.",
    "frozen set": b"\x80\x04(\x8c\x01a\x91.",
    "huge bytes": b"\x80\x02c__builtin__\nbytes\n\x8a\x05\x00\x00\x00\x00\x01\x85R.",
}


@pytest.mark.parametrize("name", HOSTILE)
def test_names_and_operations_that_are_not_in_the_tables_are_refused(name, tmp_path, monkeypatch):
    ran = []
    monkeypatch.setattr("os.system", ran.append)
    (tmp_path / "a.pkl").write_bytes(HOSTILE[name])
    with pytest.raises(InputError):
        read_pickle(tmp_path / "a.pkl")
    assert not ran
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.pkl"]


def test_reductions_of_python_objects_are_refused(tmp_path):
    target = tmp_path / "written.txt"
    for call in (_Call(np.savetxt, str(target), [1.0]), _Call(open, str(target), "w"), _Call(copyreg.pickle, int, int)):
        (tmp_path / "a.pkl").write_bytes(pickle.dumps({"v": call}))
        with pytest.raises(InputError):
            read_pickle(tmp_path / "a.pkl")
    assert not target.exists()


def test_the_table_names_no_function_of_another_module():
    assert {function.__module__ for function in NAMES.values()} == {"carigs.readers.pickled_objects"}
    assert not any("." in name for _, name in NAMES)


def test_lists_that_contain_each_other_many_times_are_refused_in_linear_time(tmp_path):
    """NumPy would visit 100^14 numbers to find the shape of an array of them."""
    value: list = [1.0]
    for _ in range(14):
        value = [value] * 100
    (tmp_path / "a.pkl").write_bytes(pickle.dumps({"v": value}))
    with pytest.raises(InputError, match="more than 67108864 entries"):
        read_pickle(tmp_path / "a.pkl")


@pytest.mark.parametrize("names", [1, 100])
def test_sparse_matrices_are_counted_with_their_zeros(names, tmp_path):
    """A file of a few hundred bytes: readers make dense arrays of sparse ones, and of each name that stands for one."""
    matrix = scipy.sparse.csc_matrix((1_000_000, 90 // names + 1))
    (tmp_path / "a.pkl").write_bytes(pickle.dumps({f"v{k}": matrix for k in range(names)}))
    with pytest.raises(InputError, match="more than 67108864 entries"):
        read_pickle(tmp_path / "a.pkl")
