"""Caches lie in a folder that takes files and that nobody else can change; without one, programs work."""

import os
import stat
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path

import numpy as np
import pytest

from carigs.errors import CarigsWarning, InputError
from carigs.mesh.ambient_occlusion import ambient_occlusion, cached_ambient_occlusion
from carigs.runs.snakemake_process import check_working_folder, snakemake_environment
from carigs.simd import kernel_cache
from carigs.simd.kernel_cache import sources_digest
from carigs.system import cache_folders
from carigs.system.cache_folders import FOREIGN, OPEN, cache_homes, can_be_made, first_usable, user_cache

pytestmark = pytest.mark.skipif(os.name != "posix", reason="owners and permissions of POSIX")
ROOT_ALONE = pytest.mark.skipif(not hasattr(os, "getuid") or os.getuid() != 0, reason="only root changes owners")
TETRAHEDRON = np.eye(4, 3), np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])


@pytest.fixture
def nowhere(tmp_path, monkeypatch):
    """No folder takes a cache: all lie below a regular file, which binds root, too."""
    file = tmp_path / "file"
    file.write_text("")
    for name in ("XDG_CACHE_HOME", "XDG_CONFIG_HOME", "HOME"):
        monkeypatch.setenv(name, str(file / name))
    for name in ("NUMBA_CACHE_DIR", "MPLCONFIGDIR", "TORCH_HOME", "HF_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(tempfile, "tempdir", str(file / "temporary"))
    monkeypatch.setattr(kernel_cache, "PACKAGE", _NotWritable(file, kernel_cache.PACKAGE))
    return file


class _NotWritable:
    """Folder of the package for `kernel_folder`: its sources can be read, nothing can be made below it."""

    def __init__(self, file, package):
        self.file, self.stat = file, package.stat

    def __truediv__(self, name):
        return self.file / name


def unknown_user(monkeypatch):
    """A number without an entry among the users, and no variable that names one."""
    for name in ("HOME", "LOGNAME", "USER", "LNAME", "USERNAME", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("pwd.getpwuid", lambda uid: {}[uid])


def test_the_users_cache_is_an_absolute_path_or_none(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    for relative in ("", "cache", "./cache", "~/cache"):
        monkeypatch.setenv("XDG_CACHE_HOME", relative)
        assert user_cache() == tmp_path / ".cache"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "new" / "cache"))
    assert user_cache() == tmp_path / "new" / "cache"
    monkeypatch.delenv("XDG_CACHE_HOME")
    for home in ("/nonexistent", str(tmp_path / ("x" * 300)), "relative"):
        monkeypatch.setenv("HOME", home)
        assert user_cache() is None


def test_an_unknown_user_has_a_folder_among_temporary_files(tmp_path, monkeypatch):
    unknown_user(monkeypatch)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    (home,) = cache_homes()
    assert home.parent == tmp_path and str(os.getuid()) in home.name
    monkeypatch.chdir(tmp_path)  # which Python takes for temporary files where it finds no other folder
    assert not list(cache_homes())


def test_the_first_folder_that_takes_files_is_made(tmp_path):
    (tmp_path / "file").write_text("")
    below, free = tmp_path / "file" / "a", tmp_path / "b" / "c"
    folder, problems = first_usable([below, tmp_path / ("x" * 300), free, tmp_path / "not tried"])
    assert folder == free and free.is_dir() and list(problems) == [below, tmp_path / ("x" * 300)]
    assert not (tmp_path / "not tried").exists()
    assert first_usable([below])[0] is None and first_usable([]) == (None, {})


def test_new_folders_are_writable_by_their_owner_alone(tmp_path):
    before = os.umask(0)
    try:
        folder, _ = first_usable([tmp_path / "cache"])
    finally:
        os.umask(before)
    assert not folder.stat().st_mode & (stat.S_IWGRP | stat.S_IWOTH)


@pytest.mark.parametrize("mode", [0o777, 0o757, 0o1777])
def test_a_folder_that_others_can_write_to_is_not_used(mode, tmp_path):
    (tmp_path / "cache").mkdir()
    (tmp_path / "cache").chmod(mode)
    assert first_usable([tmp_path / "cache"]) == (None, {tmp_path / "cache": OPEN})


@ROOT_ALONE
def test_a_folder_of_another_user_or_group_is_not_used_except_the_owner_of_the_program(tmp_path):
    (tmp_path / "theirs").mkdir()
    os.chown(tmp_path / "theirs", 54321, 54321)
    assert first_usable([tmp_path / "theirs"]) == (None, {tmp_path / "theirs": FOREIGN})
    assert first_usable([tmp_path / "theirs"], owners=[54321]) == (tmp_path / "theirs", {})
    (tmp_path / "ours").mkdir()
    os.chown(tmp_path / "ours", 0, 54321)
    assert first_usable([tmp_path / "ours"])[0] == tmp_path / "ours"
    (tmp_path / "ours").chmod(0o775)
    assert first_usable([tmp_path / "ours"]) == (None, {tmp_path / "ours": OPEN})


def kernel_folder():
    """What a fresh process finds, and the lines that it prints."""
    with warnings.catch_warnings(record=True) as lines:
        warnings.simplefilter("always")
        return kernel_cache.kernel_folder.__wrapped__(), [str(line.message) for line in lines]


def test_without_any_folder_one_line_says_what_to_set(nowhere):
    folder, (line,) = kernel_folder()
    assert folder is None and "NUMBA_CACHE_DIR" in line


def test_a_chosen_folder_that_cannot_be_used_is_named_and_another_one_taken(nowhere, tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(nowhere / "mine"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    folder, (line,) = kernel_folder()
    assert folder.is_relative_to(tmp_path / "cache") and str(folder) in line
    assert f"NUMBA_CACHE_DIR={nowhere / 'mine'}" in line and "Not a directory" in line


@pytest.mark.parametrize("place", ["NUMBA_CACHE_DIR", "XDG_CACHE_HOME"])
def test_kernels_that_others_could_have_put_there_are_not_loaded(place, nowhere, tmp_path, monkeypatch):
    monkeypatch.setenv(place, str(tmp_path / "open"))
    folder, lines = kernel_folder()
    assert folder.is_relative_to(tmp_path / "open") and not lines
    folder.chmod(0o777)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    other, (line,) = kernel_folder()
    assert other.is_relative_to(tmp_path / "temporary") and OPEN in line and str(other) in line


@ROOT_ALONE
def test_kernels_of_another_user_are_not_loaded(nowhere, tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "shared"))
    planted = tmp_path / "shared" / f"kernels-{sources_digest()}"
    planted.mkdir(parents=True)
    os.chown(planted, 54321, 54321)
    folder, lines = kernel_folder()
    assert folder is None and any(FOREIGN in line for line in lines)


def test_occlusion_is_computed_without_a_cache(nowhere):
    expected = ambient_occlusion(*TETRAHEDRON)
    np.testing.assert_array_equal(cached_ambient_occlusion(*TETRAHEDRON, np.ones(4, bool)), expected)


@pytest.mark.parametrize("variable", ["XDG_CACHE_HOME", "XDG_CONFIG_HOME"])
def test_matplotlib_gets_a_folder_only_where_it_has_none(variable, nowhere, tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    monkeypatch.setenv("MPLCONFIGDIR", "chosen")
    cache_folders.find_cache_of_matplotlib()
    assert os.environ["MPLCONFIGDIR"] == "chosen"
    monkeypatch.delenv("MPLCONFIGDIR")
    for name in ("XDG_CACHE_HOME", "XDG_CONFIG_HOME"):
        monkeypatch.setenv(name, str(tmp_path / name))
    cache_folders.find_cache_of_matplotlib()
    assert "MPLCONFIGDIR" not in os.environ and not (tmp_path / "XDG_CACHE_HOME").exists()
    monkeypatch.setenv(variable, str(nowhere / "none"))
    cache_folders.find_cache_of_matplotlib()
    assert Path(os.environ.pop("MPLCONFIGDIR")).is_dir()


def test_snakemake_gets_the_environment_of_its_user_where_that_is_enough(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("USER", "somebody")
    assert snakemake_environment() == dict(os.environ)


def test_snakemake_gets_a_cache_and_a_name_and_jobs_find_their_weights(nowhere, tmp_path, monkeypatch):
    unknown_user(monkeypatch)
    monkeypatch.setenv("XDG_CACHE_HOME", str(nowhere / "cache"))
    monkeypatch.chdir(tmp_path)
    environment = snakemake_environment()
    assert environment["LOGNAME"] == str(os.getuid())
    assert Path(environment["XDG_CACHE_HOME"]).is_relative_to(tmp_path / ".snakemake")
    assert Path(environment["XDG_CACHE_HOME"], "snakemake").is_dir()
    assert environment["TORCH_HOME"] == str(nowhere / "cache" / "torch")
    assert environment["XDG_CONFIG_HOME"] == os.environ["XDG_CONFIG_HOME"]
    monkeypatch.delenv("XDG_CONFIG_HOME")
    assert Path(snakemake_environment()["XDG_CONFIG_HOME"]).is_dir()


def test_a_working_folder_that_takes_no_files_is_named(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    check_working_folder([Path("results", "mine")])
    assert not list(tmp_path.iterdir())
    Path("results").write_text("")
    with pytest.raises(InputError, match=f"{tmp_path}/results: cannot be written to.*results"):
        check_working_folder([Path("results", "mine")])
    Path(".snakemake").write_text("")
    with pytest.raises(InputError, match=f"{tmp_path}/.snakemake: cannot be written to.*Snakemake"):
        check_working_folder()


def test_nothing_is_made_to_find_out_whether_it_can_be_made(tmp_path):
    (tmp_path / "file").write_text("")
    assert can_be_made(tmp_path / "a" / "b") and not can_be_made(tmp_path / "file" / "b")
    assert not can_be_made(Path("relative")) and not can_be_made(tmp_path / ("x" * 300) / "y")
    assert [entry.name for entry in tmp_path.iterdir()] == ["file"]


COMMANDS = [
    ["settings", "study=toy"],
    ["weights", "list"],
    ["mesh", "ball.ply", "-o", "out.obj"],
    ["plan", "study=toy"],
]


@pytest.mark.slow
@pytest.mark.parametrize("arguments", COMMANDS, ids=lambda arguments: arguments[0])
def test_commands_work_without_home_and_cache(arguments, tmp_path):
    """A user without a name or a home folder, as in a container that runs under a number."""
    import trimesh

    trimesh.creation.icosphere(subdivisions=2).export(tmp_path / "ball.ply")
    (tmp_path / "file").write_text("")
    names = ("HOME", "USER", "LOGNAME", "MPLCONFIGDIR", "NUMBA_CACHE_DIR")
    environment = {name: value for name, value in os.environ.items() if name not in names}
    environment |= {"XDG_CACHE_HOME": str(tmp_path / "file" / "cache"), "HOME": str(tmp_path / "file" / "home")}
    environment["PYTHONPATH"] = os.pathsep.join([os.environ.get("PYTHONPATH", ""), os.getcwd()])
    command = [sys.executable, "-m", "carigs", *arguments]
    done = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_warning_is_a_line_of_the_command(nowhere, capsys):
    from carigs.runs.summary import warnings_as_lines

    with warnings_as_lines():
        assert kernel_cache.kernel_folder.__wrapped__() is None
    line = capsys.readouterr().err
    assert line.startswith("carigs: warning: ") and line.count("\n") == 1 and issubclass(CarigsWarning, UserWarning)
