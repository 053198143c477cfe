"""Stands for the network in tests of downloads."""

from __future__ import annotations

import io
import re
import urllib.error
import urllib.request
from pathlib import Path


class Web:
    """Answers `urllib.request.urlopen` with `content`, as if from `address`, or raises `error`."""

    def __init__(self, content: bytes = b""):
        self.content = content
        self.address: str | None = None
        self.error: Exception | None = None
        self.sends_parts = True
        self.breaks_after: int | None = None
        self.asked: list[tuple[str, str | None]] = []

    def open(self, request: urllib.request.Request, timeout: float) -> io.BytesIO:
        if self.error is not None:
            raise self.error
        wanted = request.get_header("Range")
        self.asked.append((request.full_url, wanted))
        start = int(re.fullmatch(r"bytes=(\d+)-", wanted)[1]) if wanted and self.sends_parts else 0
        if start and start >= len(self.content):
            raise urllib.error.HTTPError(request.full_url, 416, "Range Not Satisfiable", None, None)
        part = self.content[start:]
        response = io.BytesIO(part if self.breaks_after is None else part[: self.breaks_after])
        response.geturl = lambda: self.address or request.full_url
        response.status = 206 if start else 200
        response.headers = {"Content-Length": str(len(part))}
        return response


class FolderWeb(Web):
    """Answers with the file of a folder that has the last name of the address."""

    def __init__(self, folder: Path):
        super().__init__()
        self.folder = folder

    def open(self, request: urllib.request.Request, timeout: float) -> io.BytesIO:
        file = self.folder / request.full_url.rsplit("/", 1)[1]
        if not file.is_file():
            raise urllib.error.HTTPError(request.full_url, 404, "Not Found", None, None)
        self.content = file.read_bytes()
        return super().open(request, timeout)
