"""Where the viewer listens: its socket opens before a file is read, so that a mistake ends the command at once."""

from __future__ import annotations

import errno
import socket
import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from ipaddress import ip_address

from carigs.errors import CarigsWarning, SettingsError
from carigs.viewer.admission import Admission, admission, without_brackets

LOCALHOST = "127.0.0.1"
DEFAULT_PORT, NUM_PORTS = 8080, 20
"""Without a wish, the first free one of `NUM_PORTS` ports from `DEFAULT_PORT` on is taken."""
BACKLOG = 100
_REASONS = {
    errno.EADDRINUSE: "this port is taken by another program",
    errno.EADDRNOTAVAIL: "this machine has no such address",
    errno.EACCES: "ports below 1024 need the rights of an administrator",
}


@dataclass(frozen=True)
class Listener:
    """An open socket, and whom its server answers."""

    socket: socket.socket
    host: str
    """Address or name to listen at, as the user gave it."""
    admission: Admission

    @property
    def port(self) -> int:
        """The port."""
        return self.socket.getsockname()[1]

    @property
    def address(self) -> str:
        """What to open in a browser of this machine."""
        bound = ip_address(self.socket.getsockname()[0].partition("%")[0])
        host = "localhost" if self.host == LOCALHOST or bound.is_unspecified else without_brackets(self.host)
        return f"http://[{host}]:{self.port}" if ":" in host else f"http://{host}:{self.port}"


def listen(host: str = LOCALHOST, port: int | None = None, allowed: Iterable[str] = ()) -> Listener:
    """Open the socket of a viewer. A warning is issued if other machines can reach it.

    Args:
        host: Address or name of this machine to listen at; 0.0.0.0 and :: stand for all of its addresses.
        port: Port; 0 for any that is free, None for the first free one from `DEFAULT_PORT` on.
        allowed: Further host names by which browsers reach the viewer.

    Returns:
        The socket, and whom the server answers.

    Raises:
        SettingsError: If it is not possible to listen there.
    """
    if port is not None and not 0 <= port <= 65535:
        raise SettingsError(f"--port {port}: expected 0 to 65535")
    if not host.strip():  # libraries of sockets take it for all addresses
        raise SettingsError(f"--host: expected an address or a name, such as {LOCALHOST}")
    ports = range(DEFAULT_PORT, DEFAULT_PORT + NUM_PORTS) if port is None else [port]
    family, address = _address(host)
    local = ip_address(address.partition("%")[0]).is_loopback
    admitted = admission(host, is_local=local, allowed=allowed)
    for number in ports:
        try:
            opened = socket.create_server((address, number), family=family, backlog=BACKLOG)
        except OSError as error:
            if error.errno == errno.EADDRINUSE and number != ports[-1]:
                continue
            reason = _REASONS.get(error.errno or 0, error.strerror or str(error))
            raise SettingsError(f"--host {host} --port {number}: {reason}") from error
        break
    if not local:
        reach = "all addresses of this machine" if ip_address(address).is_unspecified else "an address of its network"
        problem = f"--host {host} listens at {reach}: whoever reaches it can watch and export, there is no password"
        warnings.warn(problem, CarigsWarning, stacklevel=2)
    return Listener(opened, host, admitted)


def _address(host: str) -> tuple[socket.AddressFamily, str]:
    """Family and address that a name stands for; IPv4 if it has both."""
    try:
        found = socket.getaddrinfo(without_brackets(host), None, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    except (OSError, ValueError) as error:  # ValueError: no host name at all, such as one of 64 letters
        reason = getattr(error, "strerror", None) or "no host name"
        raise SettingsError(f"--host {host}: {reason}") from error
    family, *_, place = min(found, key=lambda entry: entry[0] != socket.AF_INET)
    return family, place[0]
