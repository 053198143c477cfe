"""Which builds of torch the set-up installs."""

from __future__ import annotations

import importlib.util
import re
import sys
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread

import pytest
from packaging.requirements import Requirement
from project import ROOT

SPEC = importlib.util.spec_from_file_location("set_up", ROOT / "set_up.py")
set_up = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(set_up)
LOCK = (ROOT / "requirements.lock").read_text()


def names(lock):
    return {line.partition("==")[0] for line in lock.splitlines() if re.match(r"[\w.-]+==", line)}


@pytest.mark.parametrize(
    ("system", "gpu", "reachable", "build"),
    [
        ("linux", False, True, "cpu"),
        ("linux", False, False, "lock"),
        ("linux", True, True, "lock"),
        ("darwin", False, True, "lock"),
        ("win32", False, True, "lock"),
    ],
)
def test_cuda_is_left_out_only_where_it_can_and_need_not_be_there(monkeypatch, capsys, system, gpu, reachable, build):
    monkeypatch.setattr(sys, "platform", system)
    monkeypatch.setattr(set_up, "has_nvidia_gpu", lambda: gpu)
    monkeypatch.setattr(set_up, "is_reachable", lambda _index: reachable)
    assert set_up.main(["--dry-run"]) == 0
    assert set_up.SIZES[build] in capsys.readouterr().out
    assert set_up.choose_build("cpu")[0] == "cpu"
    assert set_up.choose_build("lock")[0] == "lock"


def test_an_index_that_does_not_answer_is_unreachable(tmp_path):
    assert not set_up.is_reachable("http://127.0.0.1:9")
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(SimpleHTTPRequestHandler, directory=tmp_path)) as server:
        Thread(target=server.serve_forever).start()
        index = f"http://127.0.0.1:{server.server_port}"
        assert not set_up.is_reachable(index)
        (tmp_path / "torch").mkdir()
        assert set_up.is_reachable(index)
        server.shutdown()


def test_without_cuda_every_other_pin_keeps_its_hashes():
    kept, labelled = set_up.split_lock(LOCK)
    assert [Requirement(text).name for text in labelled] == list(set_up.LABELLED)
    for text in labelled:
        assert text.removesuffix("+cpu") in LOCK
    left_out = names(LOCK) - names(kept)
    assert {name for name in left_out if not set_up.OF_CUDA.match(name)} == set(set_up.LABELLED)
    assert {"triton", "cuda-toolkit", "nvidia-cublas"} <= left_out
    for block in re.split(r"\n(?=\S)", kept.strip()):
        assert block in LOCK
        assert "--hash=sha256:" in block


def test_only_torch_comes_from_the_other_index(tmp_path):
    labelled, rest, carigs = set_up.installations("cpu", tmp_path)
    assert [text for text in labelled if "==" in text] == set_up.split_lock(LOCK)[1]
    assert "--require-hashes" in rest
    assert set_up.CPU_INDEX not in rest + carigs
    everything, carigs = set_up.installations("lock", tmp_path)
    assert {"--require-hashes", str(ROOT / "requirements.lock")} <= set(everything)
    assert set_up.CPU_INDEX not in everything + carigs
