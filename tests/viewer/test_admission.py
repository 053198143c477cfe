"""Host names that are the viewer's own, in whatever way they are written."""

import socket

import pytest
from hypothesis import given
from hypothesis import strategies as st

from carigs.errors import SettingsError
from carigs.viewer.admission import Authority, admission, host_name, parse_authority

LABEL = st.text("abcdefghijklmnopqrstuvwxyz0123456789-_", min_size=1, max_size=20).filter(
    lambda text: not text.isdigit() and not text.startswith("xn--")
)
NAME = st.lists(LABEL, min_size=1, max_size=4).map(".".join)


@given(NAME, st.integers(0, 65535), st.data())
def test_letter_case_and_the_dot_of_the_root_make_no_difference(name, port, data):
    written = "".join(data.draw(st.sampled_from([c, c.upper()])) for c in name) + data.draw(st.sampled_from(["", "."]))
    assert parse_authority(f"{written}:{port}") == Authority(name, port)
    assert parse_authority(written) == Authority(name, None)


@given(st.ip_addresses(v=6))
def test_addresses_are_equal_in_every_notation(address):
    assert host_name(f"[{address.exploded}]") == host_name(address.compressed) == host_name(f"{address}%eth0")


@given(st.ip_addresses(v=4))
def test_ipv4_addresses_in_ipv6_are_the_same(address):
    assert host_name(f"[::ffff:{address}]") == host_name(f"{address}.") == str(address)


@pytest.mark.parametrize(
    "text", ["", ":80", "[", "[]", "[::1", "::1:80", "a b", "a@b", "a/b", "a:b", "a:-1", "a:123456", "a..b", "127.1",
             "a\n", "a\0b", "x" * 64, "999.1.1.1"],
)  # fmt: skip
def test_what_is_no_authority_is_none(text):
    assert parse_authority(text) is None


def refused(allowed, host, origin=None, local="127.0.0.1"):
    return allowed.refusal([host], [] if origin is None else [origin], local) is not None


def test_a_server_of_the_network_answers_at_its_addresses_and_by_the_name_of_its_machine(monkeypatch):
    monkeypatch.setattr(socket, "gethostname", lambda: "Box.example")
    opened = admission("0.0.0.0", is_local=False)
    for name in ("192.168.1.5:8080", "box:8080", "box.example", "localhost:8080", "0.0.0.0:8080"):
        assert not refused(opened, name, f"http://{name}", local="192.168.1.5")
    assert refused(opened, "192.168.1.6", local="192.168.1.5")  # of another machine
    assert refused(opened, "evil.example", local="192.168.1.5")
    assert refused(admission("127.0.0.1", is_local=True), "box.example")


def test_an_allowed_name_is_that_of_a_proxy():
    opened = admission("127.0.0.1", is_local=True, allowed=["Viewer.example."])
    assert not refused(opened, "viewer.example", "https://viewer.example")
    assert not refused(opened, "127.0.0.1:8080", "https://viewer.example")  # the proxy names the server itself
    assert refused(opened, "other.viewer.example")


@pytest.mark.parametrize("name", ["", "*", "http://a", "a:80", "a b", "b\u00fccher..example"])
def test_what_is_no_name_cannot_be_allowed(name):
    with pytest.raises(SettingsError, match="--allow-host"):
        admission("127.0.0.1", is_local=True, allowed=[name])


def test_two_headers_of_one_name_are_refused():
    allowed = admission("127.0.0.1", is_local=True)
    assert allowed.refusal(["localhost", "localhost"], [], "127.0.0.1")
    assert allowed.refusal([], [], "127.0.0.1")
    assert allowed.refusal(["localhost"], ["http://localhost", "http://localhost"], "127.0.0.1")
