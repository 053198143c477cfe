"""A local HTTP server of weights: with parts of files, and with faults."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path


class WeightServer(ThreadingHTTPServer):
    """Serves the files below a folder."""

    daemon_threads = True

    def __init__(self, folder: Path) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.folder = folder
        self.asked: list[tuple[str, str | None]] = []
        self.breaks_after: int | None = None
        """Bytes after which every connection ends."""
        self.bytes_per_second: float | None = None
        self.stalls_after: int | None = None
        """Bytes after which nothing more comes."""

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.server_port}"


@contextmanager
def serving(folder: Path) -> Iterator[WeightServer]:
    """Serve a folder while the block runs."""
    with WeightServer(folder) as server:
        threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True).start()
        try:
            yield server
        finally:
            server.shutdown()


class _Handler(BaseHTTPRequestHandler):
    server: WeightServer

    def do_GET(self) -> None:
        wanted = self.headers.get("Range")
        self.server.asked.append((self.path, wanted))
        file = self.server.folder / self.path.lstrip("/")
        if not file.is_file():
            self.send_error(404)
            return
        content = file.read_bytes()
        start = int(wanted.removeprefix("bytes=").rstrip("-")) if wanted else 0
        if start and start >= len(content):
            self.send_error(416)
            return
        self.send_response(206 if start else 200)
        self.send_header("Content-Length", str(len(content) - start))
        self.end_headers()
        self._send(content[start:])

    def _send(self, content: bytes) -> None:
        server = self.server
        if server.breaks_after is not None:
            content = content[: server.breaks_after]
        if server.stalls_after is not None:
            self.wfile.write(content[: server.stalls_after])
            self.wfile.flush()
            time.sleep(1)
            return
        step = len(content) or 1
        if server.bytes_per_second:
            step = max(1, int(server.bytes_per_second / 20))
        for first in range(0, len(content), step):
            self.wfile.write(content[first : first + step])
            if server.bytes_per_second:
                time.sleep(1 / 20)

    def log_message(self, *_arguments: object) -> None:
        """Say nothing."""
