"""Which requests the viewer answers: those for a host name that is its own, from its own page.

A page of any site may ask a server of this machine from the browser of its user. The browser names the page's site in
the header Origin. A site whose own name was pointed at 127.0.0.1 after its page was loaded (DNS rebinding) is taken for
the server itself by the browser; its name is then in the header Host.
"""

from __future__ import annotations

import re
import shlex
import socket
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from http import HTTPStatus
from ipaddress import IPv6Address, ip_address
from typing import NamedTuple

from carigs.errors import SettingsError

MAX_CLIENTS = 64
"""Connections at a time; further ones are refused."""
HANDSHAKE_SECONDS = 10.0
"""Time in which a request must have arrived."""
SILENCE_SECONDS = 60.0
"""Time after which a connection is closed if no page has reported its camera through it."""
LOCAL = ("localhost", "127.0.0.1", "::1")
"""Names of this machine in the URLs of its own browsers, and of those that reach it through a forwarded port."""
_AUTHORITY = re.compile(r"(\[[^\[\]]*\]|[^\[\]:]+)(?::([0-9]{1,5}))?")
_ORIGIN = re.compile(r"https?://(.*)", re.IGNORECASE)


class Authority(NamedTuple):
    """Host name and port of a URL."""

    name: str
    """As of `host_name`."""
    port: int | None
    """None: that of the protocol."""


def host_name(text: str) -> str | None:
    """Bring a host name or an address into the form in which equal ones are equal.

    Args:
        text: The name or the address, without a port; IPv6 with or without brackets.

    Returns:
        The name in small ASCII letters without the dot of the root, or the address as `ipaddress` writes it, without a
        zone, and IPv4 as IPv4. None if it is neither.
    """
    try:
        address = ip_address(without_brackets(text).partition("%")[0])
    except ValueError:
        pass
    else:
        mapped = address.ipv4_mapped if isinstance(address, IPv6Address) else None
        return str(mapped or address)
    try:
        name = text.removesuffix(".").encode("idna").decode("ascii").lower()
        return str(ip_address(name)) if name.replace(".", "").isdigit() else _plain(name)
    except ValueError:  # also of names that IDNA does not know
        return None


def without_brackets(text: str) -> str:
    """Take an IPv6 address out of the brackets that it has in URLs.

    Args:
        text: An address or a name.

    Returns:
        What is between the brackets, or the text itself.
    """
    return text[1:-1] if text.startswith("[") and text.endswith("]") else text


def _plain(name: str) -> str | None:
    return name if re.fullmatch(r"[a-z0-9_-]+(\.[a-z0-9_-]+)*", name) else None


def parse_authority(text: str) -> Authority | None:
    """Split what a URL or the header Host has.

    Args:
        text: A name or an address, and a port behind a colon or none.

    Returns:
        Both; None if it is something else.
    """
    match = _AUTHORITY.fullmatch(text)
    name = None if match is None else host_name(match[1])
    if match is None or name is None:
        return None
    return Authority(name, None if match[2] is None else int(match[2]))


@dataclass(frozen=True)
class Admission:
    """Whom a server answers."""

    names: frozenset[str]
    """Host names and addresses that are the server's own."""
    proxies: frozenset[str] = frozenset()
    """Those of them that a proxy shows to browsers: it may pass another Host on than the one of its page."""

    def refusal(
        self, hosts: Sequence[str], origins: Sequence[str], local_address: str
    ) -> tuple[HTTPStatus, str] | None:
        """Decide on a request.

        Args:
            hosts: Headers Host of the request.
            origins: Headers Origin.
            local_address: Address of this machine at which the request arrived. It is a name of the server, too: an
                address cannot be pointed at another machine, as names can.

        Returns:
            Status and text of the answer that refuses it; None to answer it.
        """
        host = parse_authority(hosts[0]) if len(hosts) == 1 else None
        own = self.names | {host_name(local_address)}
        if host is None or host.name not in own:
            problem = "This viewer does not answer for this host name: start it with --allow-host NAME."
            return HTTPStatus.FORBIDDEN, f"{problem}\n"
        if not origins:  # no page of a browser
            return None
        match = _ORIGIN.fullmatch(origins[0]) if len(origins) == 1 else None
        page = None if match is None else parse_authority(match[1])
        if page is None or not (page.name in self.proxies or (page.name in own and page.port == host.port)):
            return HTTPStatus.FORBIDDEN, "This page belongs to another site.\n"
        return None


def admission(host: str, *, is_local: bool, allowed: Iterable[str] = ()) -> Admission:
    """Whom a server that listens at an address answers.

    Args:
        host: The address or name, as the user gave it.
        is_local: Whether only this machine can reach it. If others can, the name of this machine is its own, too.
        allowed: Further names, such as that of a proxy.

    Returns:
        The admission.

    Raises:
        SettingsError: If one of the further names is no host name.
    """
    proxies = set()
    for text in allowed:
        name = host_name(text)
        if name is None:
            raise SettingsError(
                f"--allow-host {shlex.quote(text)}: expected a host name or an address, without port and protocol"
            )
        proxies.add(name)
    machine = socket.gethostname()
    names = {*LOCAL, host_name(host), *([] if is_local else map(host_name, (machine, machine.partition(".")[0])))}
    return Admission(frozenset(name for name in names | proxies if name is not None), frozenset(proxies))
