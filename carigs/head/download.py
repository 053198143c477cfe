"""Downloads of head models that need no registration, with checksums that are kept beside the file."""

from __future__ import annotations

import hashlib
import re
import shutil
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

from carigs.errors import InputError
from carigs.head.ict_facekit import INDEX, read_ict_facekit
from carigs.head.model import HeadModel
from carigs.readers.download import download
from carigs.readers.limits import read_bytes
from carigs.system.files import writing


class Source(NamedTuple):
    """A head model on the network."""

    title: str
    licence: str
    url: str
    """The file, or the folder of its files."""


GNM = Source(
    "GNM Head v3 of Google", "Apache-2.0", "https://huggingface.co/google/gnm-v3/resolve/main/v3_0/gnm_head.npz"
)
FACEKIT = Source(
    "ICT-FaceKit Light, (c) 2020 USC Institute for Creative Technologies",
    "MIT",
    "https://raw.githubusercontent.com/USC-ICT/ICT-FaceKit/da5f95a607f5e6b37755b38d3385d7f2853732e5/FaceXModel",
)
FACEKIT_IDENTITIES = 100
FACEKIT_CHECKSUMS = Path(__file__).with_name("ict_facekit.sha256")
"""Of the neutral mesh and the expressions at that commit, in the format of `sha256sum`; the others' are not known."""
MAX_DOWNLOAD_BYTES = 256 << 20
MAX_FACEKIT_BYTES = 16 << 20
"""Largest file of ICT-FaceKit; its meshes have 3 MB each."""
MAX_CHECKSUM_BYTES = 1 << 16
CHECKSUM = re.compile(rb"^([0-9a-fA-F]{64}) [ *](.+)$", re.MULTILINE)


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
    kept = _kept_in(file)
    with writing(file) as part:
        download(url, part, MAX_DOWNLOAD_BYTES)
        digest = _digest(part)
        _compare(digest, next(iter(_checksums(kept).values())) if kept.exists() else digest, url, kept)
        try:
            HeadModel.load(part)
        except InputError as error:
            raise InputError(f"is no head model ({error.field}: {error.problem})", file=url) from error
    _keep({file.name: digest}, kept)
    return digest


def fetch_ict_facekit(file: Path, track: Callable[[Iterable[str]], Iterable[str]] = iter) -> str:
    """Download the meshes of ICT-FaceKit Light, convert them, and keep their checksums in `{file}.sha256`.

    What is there of an interrupted download, in a folder beside the file, is not downloaded again; the folder is
    removed at the end.

    Args:
        file: Head model to create or replace.
        track: Is given the names of the files in the order in which they are downloaded, to show progress.

    Returns:
        SHA-256 of all checksums together, in hexadecimal digits.

    Raises:
        InputError: If a file cannot be downloaded, is too large, or has another checksum than it should or than the one
            that is kept, or if the files cannot be converted. Nothing is replaced then.
    """
    file = Path(file)
    kept = _kept_in(file)
    known = _checksums(FACEKIT_CHECKSUMS)
    names = [INDEX, *(f"identity{i:03d}.obj" for i in range(FACEKIT_IDENTITIES)), *known]
    expected = (_checksums(kept) if kept.exists() else {}) | known
    folder = file.with_name(f".{file.name}.parts")
    folder.mkdir(parents=True, exist_ok=True)
    digests = {}
    for name in track(names):
        url, mesh, part = f"{FACEKIT.url}/{name}", folder / name, folder / f"{name}.part"
        if not mesh.exists():
            download(url, part, MAX_FACEKIT_BYTES)
            part.rename(mesh)
        digests[name] = _digest(mesh)
        try:
            _compare(
                digests[name], expected.get(name, digests[name]), url, FACEKIT_CHECKSUMS if name in known else kept
            )
        except InputError:
            mesh.unlink()
            raise
    try:
        model = read_ict_facekit(folder)
    except InputError as error:
        (folder / Path(error.file).name).unlink(missing_ok=True)  # so that it is downloaded again
        raise
    with writing(file) as part:
        model.save(part)
    _keep(digests, kept)
    shutil.rmtree(folder)
    return _digest(kept)


def _digest(file: Path) -> str:
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _compare(digest: str, expected: str, url: str, kept: Path) -> None:
    if digest == expected:
        return
    if kept == FACEKIT_CHECKSUMS:
        raise InputError(f"has the sha256 {digest}, not {expected}", file=url, remedy="try again, on another network")
    raise InputError(f"has the sha256 {digest}, not {expected} as before; remove {kept} if this is wanted", file=url)


def _kept_in(file: Path) -> Path:
    return file.with_name(f"{file.name}.sha256")


def _keep(digests: dict[str, str], kept: Path) -> None:
    with writing(kept) as part:
        part.write_text("".join(f"{digest}  {name}\n" for name, digest in digests.items()))


def _checksums(file: Path) -> dict[str, str]:
    """Checksums by name, of a file in the format of `sha256sum`."""
    found = CHECKSUM.findall(read_bytes(file, MAX_CHECKSUM_BYTES, "checksum"))
    if not found:
        raise InputError("holds no sha256; remove the file if the model may be another one", file=file)
    return {name.decode(errors="replace"): digest.decode().lower() for digest, name in found}
