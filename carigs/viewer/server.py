"""The server of the viewer: clients, their sessions, and the thread that computes for all of them in turn."""

from __future__ import annotations

import asyncio
import contextlib
import io
import logging
import threading
import time
import warnings
from collections.abc import Iterator
from http import HTTPStatus
from pathlib import Path
from typing import Any

import viser
import websockets.asyncio.server
from threadpoolctl import threadpool_limits

from carigs.errors import CarigsError, SettingsError, one_line
from carigs.viewer import admission
from carigs.viewer.client_messages import forget_shared_handlers, restrict_messages
from carigs.viewer.exact_mode import exact_image, page_pose
from carigs.viewer.exports import Export, ExportFolder, write_export
from carigs.viewer.listening import Listener
from carigs.viewer.panel import Panel
from carigs.viewer.splat_records import SCENE_SCALE, splat_records
from carigs.viewer.state import State
from carigs.viewer.subject import Subject

MAX_DOWNLOAD = 64 << 20
"""Bytes of an export that is also offered for download."""
log = logging.getLogger(__name__)


class Viewer:
    """A running viewer.

    Attributes:
        subject: The avatars.
        exports: Where files go.
    """

    def __init__(self, subject: Subject, exports: Path, listener: Listener) -> None:
        """Start the server.

        Args:
            subject: The avatars.
            exports: Folder of exports.
            listener: The socket, see `carigs.viewer.listening.listen`, and whom the server answers.
        """
        self.subject, self.exports = subject, ExportFolder(exports)
        self._panels: dict[int, Panel] = {}
        self._wake, self._stopping = threading.Event(), threading.Event()
        self._exporting: set[int] = set()
        self._export_lock = threading.Lock()
        # A hostile message ends its connection with an error, which is no concern of the terminal.
        for name in ("websockets", "websockets.server", "asyncio"):
            logging.getLogger(name).setLevel(logging.CRITICAL)
        # What is computed for a page that is closed meanwhile.
        warnings.filterwarnings("ignore", "Queued a .* on a closed connection", UserWarning)
        self.port = listener.port
        with _serving(listener), contextlib.redirect_stdout(io.StringIO()):  # viser's table of addresses
            self._server = viser.ViserServer(listener.host, listener.port, label="carigs", verbose=False)
        forget_shared_handlers(self._server._websock_server)
        self._server._websock_server.on_client_connect(self._admit)
        self._prepare_page()
        self._server.on_client_connect(self._connected)
        self._server._websock_server.on_client_disconnect(self._disconnected)
        self._thread = threading.Thread(target=self._compute, name="viewer", daemon=True)
        self._thread.start()

    @property
    def num_clients(self) -> int:
        """Number of pages that are open."""
        return len(self._panels)

    def wait(self) -> None:
        """Wait until the viewer is stopped or interrupted."""
        while not self._stopping.wait(3600):
            pass

    def stop(self) -> None:
        """Stop the server and its threads."""
        self._stopping.set()
        self._wake.set()
        self._thread.join(timeout=10)
        with contextlib.redirect_stdout(io.StringIO()):  # viser's remark
            self._server.stop()

    def _prepare_page(self) -> None:
        server = self._server
        server.scene.set_up_direction("+y")
        server.gui.configure_theme(show_logo=False, show_share_button=False)
        server.gui.main_panel.dock_right()
        camera = self.subject.first_camera()
        _, position, fov = page_pose(camera)
        vertices = self.subject.avatar.pose().vertices
        server.initial_camera.position, server.initial_camera.fov = position, fov
        server.initial_camera.look_at = tuple(
            (0.5 * SCENE_SCALE * (vertices.min(axis=0) + vertices.max(axis=0))).tolist()
        )
        server.initial_camera.up = (0.0, 1.0, 0.0)

    async def _admit(self, connection: Any) -> None:
        socket = self._server._websock_server._live_connections[connection.client_id]
        restrict_messages(socket, connection)
        asyncio.get_running_loop().call_later(admission.SILENCE_SECONDS, self._end_silent, connection.client_id, socket)

    def _end_silent(self, number: int, socket: Any) -> None:
        if number not in self._server._connected_clients:  # viser puts them there with their first camera
            self._closing = asyncio.ensure_future(socket.close(1008, "the page has not reported its camera"))

    def _connected(self, client: viser.ClientHandle) -> None:
        try:
            panel = Panel(client, self.subject, self._wake.set)
        except Exception as error:
            if self._is_open(client.client_id):  # else it was closed meanwhile
                log.warning("a client could not be shown its page", exc_info=error)
            return
        panel.on_export = self._export
        self._panels[client.client_id] = panel
        self._wake.set()

    async def _disconnected(self, connection: Any) -> None:
        self._wake.set()

    def _is_open(self, number: int) -> bool:
        return number in self._server._websock_server._live_connections

    def _forget_departed(self) -> None:
        """Drop the pages that were closed.

        viser itself never drops a client that closes its connection while its first message is handled.
        """
        for pages in (self._panels, self._server._connected_clients):
            for number in list(pages):
                if not self._is_open(number):
                    pages.pop(number, None)

    def _compute(self) -> None:
        """Serve the sessions in turn, one step each."""
        with threadpool_limits(1, "blas"):  # products are small: threads that wait for more cost more than they do
            self._warm_up()
            self._serve()

    def _serve(self) -> None:
        while not self._stopping.is_set():
            due = None
            self._forget_departed()
            for number, panel in list(self._panels.items()):
                try:
                    with self.subject.lock:
                        next_step = panel.session.step(time.monotonic())
                except Exception as error:
                    if not self._is_open(number):  # closed meanwhile
                        continue
                    next_step = None
                    text = str(error) if isinstance(error, CarigsError) else one_line(error) or "internal error"
                    if not isinstance(error, CarigsError):
                        log.warning("a client could not be shown an image", exc_info=error)
                    with contextlib.suppress(Exception):
                        panel.show_notice(text)
                if next_step is not None:
                    due = next_step if due is None else min(due, next_step)
            self._wake.wait(None if due is None else max(due - time.monotonic(), 0.0))
            self._wake.clear()

    def _warm_up(self) -> None:
        """Load the kernels before the first client comes."""
        camera = self.subject.first_camera().scaled(0.1)
        with self.subject.lock:
            values = State(self.subject.controls).values
            world = self.subject.scenes[0].surfels(values, camera.centre)
            splat_records(world)
            exact_image(world, camera, 1.0)

    def _export(self, panel: Panel, format: str, name: str, height: float) -> None:
        """Write a file in a thread of its own; one at a time for a client, and one for all.

        Raises:
            SettingsError: If the client has asked for one before that is not written yet.
        """
        session = panel.session
        export = Export(format, name, dict(session.state.values), session.export_camera(height))
        client = panel._client
        if client.client_id in self._exporting:
            raise SettingsError("the last export is not finished yet")
        self._exporting.add(client.client_id)
        threading.Thread(target=self._write, args=(panel, client, export), daemon=True).start()

    def _write(self, panel: Panel, client: viser.ClientHandle, export: Export) -> None:
        def show(count: int) -> None:
            if self._stopping.is_set() or not self._is_open(client.client_id):
                raise SettingsError("the page was closed")
            if count > 1:
                panel.show_notice(f"{export.format}: {count} images")

        try:
            with self._export_lock:
                file = write_export(self.exports, self.subject.scenes[0], export, self.subject.lock, show)
            panel.show_notice(f"wrote {file}")
            if file.stat().st_size <= MAX_DOWNLOAD:
                client.send_file_download(file.name, file.read_bytes())
        except Exception as error:
            if not isinstance(error, CarigsError):
                log.warning("an export failed", exc_info=error)
            with contextlib.suppress(Exception):
                panel.show_notice(str(error) if isinstance(error, CarigsError) else "the export failed")
        finally:
            self._exporting.discard(client.client_id)


@contextlib.contextmanager
def _serving(listener: Listener) -> Iterator[None]:
    """Have the viser server that the block starts serve at a socket of ours, and ask `Admission` about every request.

    viser takes an address and a port alone: where it cannot listen it tries a thousand ports and then waits for ever,
    and it answers every request. So `serve`, by which it opens its socket, is replaced meanwhile. A refused request
    never becomes a client of viser, and whatever goes wrong on the way to one, websockets closes the connection.
    """
    serve = websockets.asyncio.server.serve

    def serve_at_socket(handler: Any, *_: Any, process_request: Any, **options: Any) -> Any:
        def answer(connection: Any, request: Any) -> Any:
            headers = request.headers
            here, *_ = connection.local_address
            refusal = listener.admission.refusal(headers.get_all("Host"), headers.get_all("Origin"), here)
            if refusal is None and len(connection.server.connections) >= admission.MAX_CLIENTS:
                refusal = HTTPStatus.SERVICE_UNAVAILABLE, "Too many clients.\n"
            return process_request(connection, request) if refusal is None else connection.respond(*refusal)

        limits = {"open_timeout": admission.HANDSHAKE_SECONDS}
        return serve(handler, sock=listener.socket, process_request=answer, **limits, **options)

    websockets.asyncio.server.serve = serve_at_socket
    try:
        yield
    finally:
        websockets.asyncio.server.serve = serve
