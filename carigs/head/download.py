"""Downloads of head models that need no registration, with a checksum that is kept beside the file."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

from carigs.errors import InputError
from carigs.head.model import HeadModel
from carigs.readers.download import download
from carigs.readers.limits import read_bytes
from carigs.system.files import writing

GNM_URL = "https://huggingface.co/google/gnm-v3/resolve/main/v3_0/gnm_head.npz"
"""GNM Head v3 (google/GNM, Apache-2.0)."""
MAX_DOWNLOAD_BYTES = 256 << 20
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
        download(url, part, MAX_DOWNLOAD_BYTES)
        digest = hashlib.sha256(part.read_bytes()).hexdigest()
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
