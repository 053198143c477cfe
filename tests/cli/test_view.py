"""`carigs view`: what it refuses, and a viewer from the first line to Ctrl-C."""

import os
import signal
import socket
import subprocess
import sys
import urllib.request

import psutil
import pytest
from avatars import ball_avatar

from carigs.cli.main import main as carigs
from carigs.splat.avatar import save_avatar


@pytest.fixture(scope="module")
def avatar(tmp_path_factory):
    file = tmp_path_factory.mktemp("avatar") / "avatar.npz"
    save_avatar(file, ball_avatar())
    return file


def test_starting_carigs_imports_no_viser():
    code = "import sys, carigs.cli.main, carigs.cli.view, carigs.system.fork_server; print('viser' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "False"


def test_without_viser_it_says_what_to_install(avatar, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "viser", None)
    assert carigs(["view", str(avatar)]) == 1
    assert "pip install 'carigs[viewer]'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["--port", "70000"], "--port 70000"),
        (["--port", "-1"], "--port -1"),
        (["--host", ""], "--host"),
        (["--host", "a b"], "--host a b"),
        (["--host", "203.0.113.7"], "--host 203.0.113.7"),
        (["--allow-host", "http://a/"], "--allow-host http://a/"),
        (["--allow-host", ""], "--allow-host ''"),
        (["--allow-host", " "], "--allow-host ' '"),
        (["--truth", "truth.json"], "--truth needs --capture"),
        (["--exports", __file__], "is no folder"),
        (["--capture", "no/capture.json"], "no/capture.json"),
        (["no.npz"], "no.npz"),
    ],
)
def test_mistakes_end_it_with_one_line(avatar, capsys, monkeypatch, arguments, problem):
    pytest.importorskip("viser")
    assert carigs(["view", str(avatar), *arguments]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert problem in line


@pytest.mark.slow
def test_the_viewer_listens_at_this_machine_until_it_is_interrupted(avatar, tmp_path):
    pytest.importorskip("viser")
    command = [sys.executable, "-m", "carigs", "view", str(avatar), "--port", "0", "--exports", str(tmp_path / "out")]
    viewer = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ)
    try:
        line = viewer.stdout.readline()
        address = line.split()[1]
        assert address.startswith("http://localhost:")
        with urllib.request.urlopen(address.replace("localhost", "127.0.0.1"), timeout=20) as page:
            assert page.status == 200 and b"<html" in page.read(2000)
        listening = _listening(int(address.rsplit(":", 1)[1]))
        assert listening == {"127.0.0.1"}
    finally:
        viewer.send_signal(signal.SIGINT)
        out, err = viewer.communicate(timeout=30)
    assert viewer.returncode == 0 and out.splitlines()[-1] == "ended" and "Traceback" not in err
    assert not (tmp_path / "out").exists()


def test_a_taken_port_ends_it_before_the_avatar_is_read(capsys):
    """It hung: viser tried a thousand ports, and then waited for a server that never came."""
    pytest.importorskip("viser")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        assert carigs(["view", "no.npz", "--port", str(taken.getsockname()[1])]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert "this port is taken" in line


def _listening(port):
    connections = [c for child in psutil.Process().children() for c in child.net_connections("inet")]
    return {c.laddr.ip for c in connections if c.status == psutil.CONN_LISTEN and c.laddr.port == port}


def test_help_says_how_to_open_it_from_elsewhere(capsys):
    with pytest.raises(SystemExit):
        carigs(["view", "--help"])
    assert "ssh -L" in capsys.readouterr().out
