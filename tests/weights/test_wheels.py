"""Files of weights inside wheels; pip is replaced by a program that finds one wheel."""

import hashlib
import importlib.util
import subprocess
import zipfile

import pytest

from carigs.cli.main import main
from carigs.errors import InputError
from carigs.weights import wheels
from carigs.weights.registry import registered
from carigs.weights.wheels import Member, fetch_from_wheel

CONTENT = b"weights" * 100
SHA256 = hashlib.sha256(CONTENT).hexdigest()


class Pip:
    """Answers `subprocess.run`."""

    def __init__(self):
        self.files = {"net/a.tflite": CONTENT, "net/code.py": b"raise"}
        self.error = ""
        self.commands = []

    def run(self, command, **_options):
        self.commands.append(command)
        if not self.error:
            folder = command[command.index("--dest") + 1]
            with zipfile.ZipFile(f"{folder}/net-1.0-py3-none-any.whl", "w") as archive:
                for name, content in self.files.items():
                    archive.writestr(name, content)
        return subprocess.CompletedProcess(command, int(bool(self.error)), "", self.error)


@pytest.fixture
def pip(monkeypatch):
    pip = Pip()
    monkeypatch.setattr(wheels.subprocess, "run", pip.run)
    return pip


def test_the_files_are_kept_and_nothing_else(pip, tmp_path):
    fetch_from_wheel("net==1.0", [Member("net/a.tflite", tmp_path / "weights/a.tflite", len(CONTENT), SHA256)])
    assert (tmp_path / "weights/a.tflite").read_bytes() == CONTENT
    assert [file.name for file in tmp_path.rglob("*")] == ["weights", "a.tflite"]
    (command,) = pip.commands
    assert command[1:5] == ["-m", "pip", "download", "net==1.0"] and "--no-deps" in command


@pytest.mark.parametrize(
    ("content", "size", "sha256"),
    [(CONTENT[:-1], 700, SHA256), (CONTENT + b"0", 700, SHA256), (CONTENT, 700, "0" * 64)],
)
def test_another_file_is_refused_and_nothing_is_written(pip, tmp_path, content, size, sha256):
    pip.files["net/b.tflite"] = content
    members = [
        Member("net/a.tflite", tmp_path / "a.tflite", len(CONTENT), SHA256),
        Member("net/b.tflite", tmp_path / "b.tflite", len(CONTENT), sha256),
    ]
    with pytest.raises(InputError, match=r"net==1.0: net/b.tflite: another file"):
        fetch_from_wheel("net==1.0", members)
    assert list(tmp_path.iterdir()) == []


def test_a_wheel_without_the_file_is_refused(pip, tmp_path):
    with pytest.raises(InputError, match=r"net/c.tflite: not in the wheel"):
        fetch_from_wheel("net==1.0", [Member("net/c.tflite", tmp_path / "c.tflite", 1, SHA256)])


def test_what_pip_says_is_one_line(pip, tmp_path):
    pip.error = "WARNING: slow\nERROR: Could not find a version\nERROR: No matching distribution found for net==1.0\n"
    with pytest.raises(InputError, match=r"^net==1.0: pip cannot download it \(No matching distribution found"):
        fetch_from_wheel("net==1.0", [])


def test_without_pip_there_is_one_line(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match="needs pip"):
        fetch_from_wheel("net==1.0", [])


def test_the_command_fetches_and_names_what_fails(pip, tmp_path, capsys, monkeypatch):
    for name in ("HF_HUB_CACHE", "CARIGS_WEIGHTS"):
        monkeypatch.delenv(name, raising=False)
    for name in ("HF_HOME", "TORCH_HOME"):
        monkeypatch.setenv(name, str(tmp_path / name))
    assert main(["weights", "fetch", "mediapipe_face", "--folder", str(tmp_path)]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "mediapipe==0.10.21" in error and "not in the wheel" in error
    assert main(["weights", "list", "mediapipe_face", "--folder", str(tmp_path)]) == 0
    assert "missing; from the wheel of mediapipe==0.10.21" in capsys.readouterr().out


def test_files_in_wheels_have_all_that_is_verified():
    weights = registered("mediapipe_face")
    assert weights.folder and all(file.member and file.bytes and len(file.sha256) == 64 for file in weights.files)
