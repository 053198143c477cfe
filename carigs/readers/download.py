"""Downloads over https, or from this machine, with a limit on the size; an interrupted one is continued."""

from __future__ import annotations

import http.client
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Callable
from pathlib import Path

from carigs.errors import InputError

TIMEOUT_SECONDS = 60
BLOCK = 1 << 20
THIS_MACHINE = ("127.0.0.1", "::1", "localhost")


def download(
    url: str, file: Path, max_bytes: int, report: Callable[[int, int | None], None] = lambda done, total: None
) -> None:
    """Download a file.

    Args:
        url: Where it is: https, or http from a server on this machine.
        file: File to write. What it already holds is the beginning of an interrupted download: the rest is asked for,
            and everything where the server cannot send a part.
        max_bytes: Largest size that is accepted.
        report: Called with the bytes so far and, if the server states it, their final number.

    Raises:
        InputError: It cannot be downloaded or is too large. What came stays in the file.
    """
    if not _is_allowed(url):
        raise InputError("only https is downloaded", file=url)
    done = file.stat().st_size if file.is_file() else 0
    headers = {"User-Agent": "carigs"} | ({"Range": f"bytes={done}-"} if done else {})
    try:
        with urllib.request.urlopen(urllib.request.Request(url, headers=headers), timeout=TIMEOUT_SECONDS) as response:
            if not _is_allowed(response.geturl()):
                raise InputError("is redirected to an address that is not https", file=url)
            if response.status != http.client.PARTIAL_CONTENT:
                done = 0
            length = response.headers.get("Content-Length", "")
            total = done + int(length) if length.isdecimal() else None
            with file.open("ab" if done else "wb") as stream:
                while block := response.read(BLOCK):
                    done += len(block)
                    if done > max_bytes:
                        raise InputError(f"more than {max_bytes} bytes", file=url)
                    stream.write(block)
                    report(done, total)
    except urllib.error.HTTPError as error:
        error.close()
        if error.code == http.client.REQUESTED_RANGE_NOT_SATISFIABLE and done:  # all of it came before
            return
        raise InputError(f"cannot be downloaded (HTTP {error.code} {error.reason})", file=url) from error
    except (OSError, http.client.HTTPException) as error:  # URLError is an OSError
        reason = getattr(error, "reason", None) or error
        raise InputError(f"cannot be downloaded ({reason})", file=url) from error
    if total not in (None, done):
        raise InputError(f"the connection ended after {done} of {total} bytes", file=url)


def _is_allowed(url: str) -> bool:
    """Whether nobody on the way can change what comes: https, or a server on this machine, such as a mirror."""
    try:
        parts = urllib.parse.urlsplit(url)
        return parts.scheme == "https" or (parts.scheme == "http" and parts.hostname in THIS_MACHINE)
    except ValueError:  # a port that is no number
        return False
