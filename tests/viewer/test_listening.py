"""Where the viewer cannot listen it says so at once."""

import socket
import warnings
from contextlib import closing

import pytest
from viewer_client import answer_to

from carigs.errors import CarigsWarning, SettingsError
from carigs.viewer import listening
from carigs.viewer.listening import listen


@pytest.fixture
def taken():
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server.getsockname()[1]


def test_a_port_that_was_asked_for_is_taken_or_refused(taken):
    with pytest.raises(SettingsError, match=f"--port {taken}: this port is taken"):
        listen(port=taken)


def test_without_a_wish_the_next_free_port_is_taken(taken, monkeypatch):
    monkeypatch.setattr(listening, "DEFAULT_PORT", taken)
    with closing(listen().socket) as opened:
        assert opened.getsockname()[0] == "127.0.0.1" and taken < opened.getsockname()[1] < taken + 20
    monkeypatch.setattr(listening, "NUM_PORTS", 1)
    with pytest.raises(SettingsError, match="is taken"):
        listen()


@pytest.mark.parametrize("host", ["", " ", "\t"])
def test_no_host_is_not_every_host(host):
    """Libraries of sockets take an empty name for all addresses."""
    with pytest.raises(SettingsError, match="--host: expected an address"):
        listen(host, 0)


@pytest.mark.parametrize("host", ["no such host", "a..b", "x" * 64, "\0", "256.1.1.1", "http://localhost", "*", "[::1"])
def test_what_is_no_host_is_refused(host, monkeypatch):
    def unknown(*_, **__):
        raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")

    with pytest.raises(SettingsError, match="--host "):
        listen(host, 0)
    monkeypatch.setattr(socket, "getaddrinfo", unknown)  # nosuchhost.invalid, without asking the network
    with pytest.raises(SettingsError, match=r"--host nosuchhost\.invalid: Name or service not known"):
        listen("nosuchhost.invalid", 0)


@pytest.mark.parametrize("port", [-1, 65536, 70000, 10**30])
def test_ports_that_do_not_exist_are_refused(port):
    with pytest.raises(SettingsError, match=f"--port {port}: expected 0 to 65535"):
        listen(port=port)


def test_addresses_of_other_machines_are_refused():
    with pytest.raises(SettingsError, match="this machine has no such address"):
        listen("203.0.113.7", 0)  # of no machine (RFC 5737)


def test_listening_to_the_network_is_warned_of():
    for host in ("0.0.0.0", "0", "::"):
        if host == "::" and not socket.has_ipv6:
            continue
        with pytest.warns(CarigsWarning, match="there is no password"), closing(listen(host, 0).socket) as opened:
            assert opened.getsockname()[0] in ("0.0.0.0", "::")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for host in ("127.0.0.1", "localhost", "127.0.0.2"):
            listen(host, 0).socket.close()


def test_the_address_can_be_opened():
    for host, shown in (("127.0.0.1", "localhost"), ("127.0.0.2", "127.0.0.2"), ("[::1]", "[::1]")):
        with closing((listener := listen(host, 0)).socket):
            assert listener.address == f"http://{shown}:{listener.port}"


def test_a_connection_that_never_finishes_its_handshake_is_ended(monkeypatch, tmp_path):
    pytest.importorskip("viser")
    from avatars import ball_avatar

    from carigs.library import HeadAvatar
    from carigs.viewer import admission
    from carigs.viewer.server import Viewer
    from carigs.viewer.subject import Subject

    monkeypatch.setattr(admission, "HANDSHAKE_SECONDS", 0.3)
    viewer = Viewer(Subject(HeadAvatar(ball_avatar())), tmp_path, listen(port=0))
    try:
        for said in (b"", b"GET / HTTP/1.1\r\nHost: loc"):
            with socket.create_connection(("127.0.0.1", viewer.port), timeout=10) as slow:
                slow.sendall(said)
                assert slow.recv(1) == b""
        assert answer_to(viewer.port, host="localhost") == 200
    finally:
        viewer.stop()
