"""Reader of .zip files, member by member: nothing is unpacked to disk, so no name in the file becomes a path."""

from __future__ import annotations

import zipfile
import zlib
from pathlib import Path
from types import TracebackType
from typing import Self

from carigs.errors import InputError
from carigs.readers.limits import max_unpacked_bytes, regular_file_size

MAX_MEMBERS = 200_000
"""Most members that are listed: a capture of an hour at 30 frames per second has 108 000 frames."""
COMPRESSIONS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""Zlib stops at a given size, the other methods' libraries do not."""
_DAMAGE = (OSError, ValueError, EOFError, NotImplementedError, RuntimeError, zipfile.BadZipFile, zlib.error)
"""Exceptions of `zipfile` and `zlib` for damaged and encrypted files."""


class Archive:
    """An open .zip file. Use it as a context manager, or call `close`."""

    def __init__(self, file: Path) -> None:
        """Read the directory of the archive.

        Args:
            file: The .zip file.

        Raises:
            InputError: If it is missing or damaged, or holds two members of one name or more than `MAX_MEMBERS`.
        """
        regular_file_size(file, "archive")
        self.file = file
        try:
            self._archive = zipfile.ZipFile(file)
        except _DAMAGE as error:
            raise InputError(f"not a readable .zip ({error})", file=file) from error
        members = [member for member in self._archive.infolist() if not member.is_dir()]
        self._members = {member.filename: member for member in members}
        if len(members) > MAX_MEMBERS or len(self._members) < len(members):
            many = len(members) > MAX_MEMBERS
            self.close()
            problem = f"{len(members)} members; at most {MAX_MEMBERS} are read" if many else "two members have one name"
            raise InputError(problem, file=file)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._archive.close()

    @property
    def names(self) -> list[str]:
        """Names of the members, without folders, in the order of the archive."""
        return list(self._members)

    def read(self, name: str, limit: int) -> bytes:
        """Read a member.

        Args:
            name: Its name.
            limit: Largest size in bytes. More is never unpacked.

        Returns:
            Its content.

        Raises:
            InputError: If there is no such member, it is too large or damaged, or is compressed in an unknown way.
        """
        if name not in self._members:
            raise InputError("no such file in the archive", file=self.file, field=name)
        member = self._members[name]
        limit = min(limit, max_unpacked_bytes(member.compress_size))
        if member.file_size > limit:
            raise InputError(f"{member.file_size} bytes; at most {limit} are read", file=self.file, field=name)
        if member.compress_type not in COMPRESSIONS:
            raise InputError("compressed in a way that is not read", file=self.file, field=name)
        try:
            with self._archive.open(member) as stream:
                content = stream.read(member.file_size)  # the checksum is compared at the end
                ended = not stream.read(1)
        except _DAMAGE as error:
            raise InputError(f"damaged in the archive ({error})", file=self.file, field=name) from error
        if len(content) != member.file_size or not ended:
            raise InputError("damaged in the archive (another size than stated)", file=self.file, field=name)
        return content
