"""Network weights: no code runs, and what is not finite parameters by name is refused."""

from __future__ import annotations

import pickle
import zipfile

import pytest
import torch
from safetensors.torch import save_file

from carigs.errors import InputError
from carigs.readers.weights import read_weights

STATE = {"a.weight": torch.arange(6.0).reshape(2, 3), "a.bias": torch.zeros(2, dtype=torch.float16)}


@pytest.mark.parametrize("kind", ["pt", "legacy.pt", "safetensors"])
def test_parameters_come_back(kind, tmp_path):
    file = tmp_path / f"net.{kind}"
    if kind == "safetensors":
        save_file(STATE, file)
    else:
        torch.save(STATE, file, _use_new_zipfile_serialization=kind == "pt")
    found = read_weights(file)
    assert found.keys() == STATE.keys()
    assert all(torch.equal(found[name], STATE[name]) for name in STATE)


class _Call:
    def __init__(self, function, *args):
        self.call = function, args

    def __reduce__(self):
        return self.call


@pytest.mark.parametrize("zipped", [True, False])
def test_payloads_do_not_run(zipped, tmp_path):
    mark = tmp_path / "ran"
    torch.save({"a": _Call(open, str(mark), "w")}, tmp_path / "net.pt", _use_new_zipfile_serialization=zipped)
    with pytest.raises(InputError, match=r"net\.pt: not a readable file of weights"):
        read_weights(tmp_path / "net.pt")
    assert not mark.exists()


REFUSED = {
    "a list": [torch.zeros(1)],
    "a checkpoint": {"state_dict": STATE},
    "a number": {"a": 3.0},
    "nothing": {},
    "numbered": {0: torch.zeros(1)},
    "nan": {"a": torch.tensor([0.0, float("nan")])},
    "complex": {"a": torch.zeros(1, dtype=torch.complex64)},
    "sparse": {"a": torch.eye(3).to_sparse()},
    "a view of 4 bytes as 4 TB": {"a": torch.zeros(1).expand(1 << 20, 1 << 20)},
    "meta": {"a": torch.zeros(3, device="meta")},
}


@pytest.mark.parametrize("name", REFUSED)
def test_anything_but_finite_parameters_by_name_is_refused(name, tmp_path):
    torch.save(REFUSED[name], tmp_path / "net.pt")
    with pytest.raises(InputError, match=r"net\.pt: "):
        read_weights(tmp_path / "net.pt")


def test_what_is_no_file_of_weights_is_refused(tmp_path):
    torch.save(STATE, tmp_path / "net.pt")
    whole = (tmp_path / "net.pt").read_bytes()
    contents = [b"", b"x", whole[:100], whole[:-30], pickle.dumps(STATE["a.bias"].numpy()), b"\x80\x02]q\x00."]
    for suffix in ("pt", "safetensors"):
        for content in contents:
            (tmp_path / f"bad.{suffix}").write_bytes(content)
            with pytest.raises(InputError, match=rf"bad\.{suffix}: "):
                read_weights(tmp_path / f"bad.{suffix}")
    with zipfile.ZipFile(tmp_path / "bad.pt", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("net/data.pkl", bytes(1 << 20))
    with pytest.raises(InputError, match="compressed"):
        read_weights(tmp_path / "bad.pt")
    with pytest.raises(InputError, match="no such file"):
        read_weights(tmp_path / "none.pt")
