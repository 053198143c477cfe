"""Downloads of head models that need no registration, with a checksum that is kept beside the file."""

from __future__ import annotations

import hashlib
import http.client
import re
import urllib.error
import urllib.request
from pathlib import Path

from carigs.errors import InputError
from carigs.files import writing
from carigs.head.model import HeadModel
from carigs.readers.limits import read_bytes

GNM_URL = "https://huggingface.co/google/gnm-v3/resolve/main/v3_0/gnm_head.npz"
"""GNM Head v3 (google/GNM, Apache-2.0)."""
MAX_DOWNLOAD_BYTES = 256 << 20
TIMEOUT_SECONDS = 60
BLOCK = 1 << 20
MAX_DIGEST_BYTES = 1 << 12
DIGEST = re.compile(rb"([0-9a-fA-F]{64})\b")


def fetch_head(url: str, file: Path) -> str:
    """Download a head model, check that it can be read, and keep its checksum in `{file}.sha256`.

    Args:
        url: Where it is; https.
        file: File to create or replace.

    Returns:
        SHA-256 of the file in hexadecimal digits.

    Raises:
        InputError: If it cannot be downloaded, is too large or no head model, or has another checksum than the one that
            is kept, or this one cannot be read. Nothing is replaced then.
    """
    file = Path(file)
    kept = file.with_name(f"{file.name}.sha256")
    with writing(file) as part:
        digest = _download(url, part)
        if kept.exists() and (known := _kept_digest(kept)) != digest:
            problem = f"has the sha256 {digest}, not {known} as before; remove {kept} if this is wanted"
            raise InputError(problem, file=url)
        try:
            HeadModel.load(part)
        except InputError as error:
            raise InputError(f"is no head model ({error.field}: {error.problem})", file=url) from error
    with writing(kept) as part:
        part.write_text(f"{digest}  {file.name}\n")
    return digest


def _kept_digest(file: Path) -> str:
    found = DIGEST.match(read_bytes(file, MAX_DIGEST_BYTES, "checksum"))
    if found is None:
        raise InputError("holds no sha256; remove the file if the model may be another one", file=file)
    return found[1].decode().lower()


def _download(url: str, file: Path) -> str:
    if not url.startswith("https://"):
        raise InputError("only https is downloaded", file=url)
    digest, size = hashlib.sha256(), 0
    request = urllib.request.Request(url, headers={"User-Agent": "carigs"})
    try:
        with urllib.request.urlopen(request, timeout=TIMEOUT_SECONDS) as response, file.open("wb") as stream:
            if not response.geturl().startswith("https://"):
                raise InputError("is redirected to an address that is not https", file=url)
            while block := response.read(BLOCK):
                size += len(block)
                if size > MAX_DOWNLOAD_BYTES:
                    raise InputError(f"more than {MAX_DOWNLOAD_BYTES} bytes", file=url)
                digest.update(block)
                stream.write(block)
    except urllib.error.HTTPError as error:
        raise InputError(f"cannot be downloaded (HTTP {error.code} {error.reason})", file=url) from error
    except (OSError, http.client.HTTPException) as error:  # URLError is an OSError
        reason = getattr(error, "reason", None) or error
        raise InputError(f"cannot be downloaded ({reason})", file=url) from error
    return digest.hexdigest()
