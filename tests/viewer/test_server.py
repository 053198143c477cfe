"""A running viewer and its clients over raw websockets, friendly and hostile."""

import os
import time

import cv2
import numpy as np
import psutil
import pytest
from avatars import ball_avatar

pytest.importorskip("viser")
from viewer_client import CAMERA, Client, answer_to
from websockets.exceptions import ConnectionClosed, InvalidStatus

from carigs.library import HeadAvatar
from carigs.viewer import admission, client_messages, server
from carigs.viewer.controls import controls_of
from carigs.viewer.exact_mode import View, exact_image
from carigs.viewer.listening import listen
from carigs.viewer.scene import HeadScene
from carigs.viewer.server import Viewer
from carigs.viewer.state import State
from carigs.viewer.subject import Subject

WINDOW = View(CAMERA["wxyz"], CAMERA["position"], CAMERA["fov"], CAMERA["image_width"], CAMERA["image_height"])


@pytest.fixture(scope="module")
def viewer(tmp_path_factory):
    viewer = Viewer(Subject(HeadAvatar(ball_avatar())), tmp_path_factory.mktemp("viewer") / "exports", listen(port=0))
    yield viewer
    viewer.stop()


@pytest.fixture(autouse=True)
def nobody_stays(viewer):
    """Every test begins and ends without clients: none is kept after it has left."""
    yield
    for client in Client.opened:
        client.close()
    Client.opened.clear()
    until(lambda: viewer.num_clients == 0)
    assert not viewer._server._connected_clients


def decoded(png):
    return cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)[:, :, ::-1] / 255


def until(condition, seconds=90.0):
    end = time.monotonic() + seconds
    while not (result := condition()):
        assert time.monotonic() < end
        time.sleep(0.02)
    return result


def notice(client, text):
    """Wait for a notice or a status line that holds a text."""
    return client.wait_for(
        lambda m: m["type"] == "GuiUpdateMessage" and text in str(m["updates"].get("_markdown", m["updates"]))
    )


def test_moving_gamma_moves_the_splats(viewer):
    client = Client(viewer.port)
    gamma = client.control("gamma")
    first = client.wait_for(lambda m: m["type"] == "SceneNodeUpdateMessage" and "buffer" in m["updates"])
    client.move(gamma, 0.0)  # it opens at 0.25
    second = client.wait_for(lambda m: m["type"] == "SceneNodeUpdateMessage" and "buffer" in m["updates"])
    centres = [
        np.frombuffer(m["buffers"][m["updates"]["buffer"]["__binary_index"]], np.uint32).reshape(-1, 8)[:, :3]
        for m in (first, second)
    ]
    moved = np.abs(np.diff([np.ascontiguousarray(c).view(np.float32) for c in centres], axis=0))
    assert len(centres[0]) == 600 and moved.max() > 0.1
    client.close()


def test_still_images_are_those_of_the_rasteriser(viewer):
    client, scene = Client(viewer.port), HeadScene(viewer.subject.avatar)
    labels = client.controls("gamma", "mode")
    client.move(labels["mode"], "exact")
    state = State(controls_of(viewer.subject.avatar))
    for level in (0.0, 0.1, 0.25):
        for wxyz, position in (
            (CAMERA["wxyz"], CAMERA["position"]),
            ((0.0, 0.966, 0.0, 0.259), (-5.0, 0.0, 8.66)),
            ((0.259, 0.966, 0.0, 0.0), (0.0, 5.0, 8.66)),
        ):
            client.move(labels["gamma"], level)
            client.send({**CAMERA, "wxyz": wxyz, "position": position})
            state.set("level", level, 0.0)
            camera = WINDOW._replace(wxyz=wxyz, position=position).camera()
            expected = exact_image(scene.surfels(state.values, camera.centre), camera, 1.0)
            psnr = 0.0
            while psnr < 45:  # an image of the last view may still be on its way
                image = decoded(client.image())
                psnr = -10 * np.log10(np.square(image - expected).mean())
            assert expected.std() > 0.05
    client.close()


def test_clients_have_their_own_values(viewer):
    def levels():
        return sorted(p.session.state.values["level"] for p in viewer._panels.values())

    one, other = Client(viewer.port), Client(viewer.port)
    gamma, others_gamma = one.control("gamma"), other.control("gamma")
    one.move(gamma, 0.2)
    until(lambda: 0.2 in levels())
    other.move(gamma, 0.1)  # of another client: no effect
    other.move(others_gamma, 0.15)
    until(lambda: 0.15 in levels())
    assert levels() == [0.15, 0.2]
    one.close()


MALFORMED = (
    b"", b"\xc1", os.urandom(300), "text", b"\x80", b"\x81\xa4type\xa1x", b"\x81\xa4type\xb0GuiUpdateMessage",
    b"\x91" * 40_000, b"x" * (client_messages.MAX_MESSAGE + 1),
)  # fmt: skip


@pytest.mark.parametrize("message", MALFORMED, ids=range(len(MALFORMED)))
def test_malformed_messages_end_their_connection_alone(viewer, message):
    bystander, client = Client(viewer.port), Client(viewer.port)
    gamma = bystander.control("gamma")
    client.receive()
    client.socket.send(message)
    with pytest.raises(ConnectionClosed):
        for _ in range(200):
            client.receive(5.0)
    bystander.move(gamma, 0.15)
    bystander.wait_for(lambda m: m["type"] == "SceneNodeUpdateMessage" and "buffer" in m["updates"])
    bystander.close()


def test_values_of_wrong_types_change_nothing(viewer):
    client = Client(viewer.port)
    labels = client.controls("gamma", "mode", "divider", "format", "name", "height")
    for uuid in labels.values():
        for value in (float("nan"), float("inf"), "x", None, [1, 2], {}, 1e300, "../../x", -1):
            client.move(uuid, value)
        client.send(
            {"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"update_cb": [], "removed": 1, "value": "y"}}
        )
    client.send({"type": "GuiUpdateMessage", "uuid": labels["gamma"], "updates": {"no such": 1}})
    client.send({**CAMERA, "fov": float("nan")})
    client.send({**CAMERA, "position": (1e300, 0.0, 0.0)})
    client.send({**CAMERA, "image_width": 10**9})
    client.send({"type": "ShareUrlRequest"})
    client.close()
    other = Client(viewer.port)
    other.move(other.control("gamma"), 0.2)
    other.wait_for(lambda m: m["type"] == "SceneNodeUpdateMessage" and "buffer" in m["updates"])
    assert viewer._server._share_tunnel is None


def test_messages_that_fill_the_memory_are_ignored(viewer):
    client, buffer = Client(viewer.port), viewer._server._websock_server._broadcast_buffer
    name, (panel,) = client.control("name"), until(lambda: list(viewer._panels.values()))
    kept = len(buffer.message_from_id)
    for i in range(50):
        client.send({"type": "GuiFormDirtyMessage", "uuid": f"{i}" * 1000})
        client.send({"type": "FileTransferStartUpload", "source_component_uuid": name, "transfer_uuid": str(i),
                     "filename": "x", "mime_type": "x", "part_count": 10**9, "size_bytes": 10**12})  # fmt: skip
        client.send({"type": "FileTransferPart", "source_component_uuid": name, "transfer_uuid": str(i),
                     "part_index": i, "content": b"x" * 10_000})  # fmt: skip
    client.move(name, "x" * 101)
    client.send({"type": "GuiUpdateMessage", "uuid": name, "updates": {"value": "x", "update_cb": []}})
    client.move(name, "taken")
    until(lambda: panel._name.value == "taken")
    assert len(buffer.message_from_id) == kept
    assert not panel._client.gui._current_file_upload_states and panel._name._impl.update_cb == []


def test_clients_that_leave_at_once_are_forgotten(viewer):
    for _ in range(40):
        Client(viewer.port).close()
    client = Client(viewer.port)
    client.control("gamma")
    until(lambda: viewer.num_clients == 1 and len(viewer._server._connected_clients) == 1)


def test_a_flood_of_values_ends_in_the_last_one(viewer):
    client = Client(viewer.port)
    gamma, (panel,) = client.control("gamma"), until(lambda: list(viewer._panels.values()))
    for i in range(5000):
        client.move(gamma, 0.25 * (i % 100) / 99)
    until(lambda: panel.session.state.values["level"] == 0.25)


@pytest.mark.parametrize("name", ["../escaped", "/escaped", "a/../../escaped", ".."])
def test_exports_land_in_no_other_folder(viewer, name):
    client = Client(viewer.port)
    labels = client.controls("name", "height", "export")
    client.move(labels["height"], 128)
    client.move(labels["name"], name)
    client.move(labels["export"], True)
    notice(client, "name of an export")
    assert not list(viewer.exports.folder.parent.rglob("*escaped*"))


def test_notices_outlast_the_status_line(viewer):
    """What was refused stays on the page while images go on: the status line changes with every image."""
    client, (panel,) = Client(viewer.port), until(lambda: list(viewer._panels.values()))
    labels = client.controls("gamma", "name", "export")
    client.move(labels["name"], "..")
    client.move(labels["export"], True)
    notice(client, "name of an export")
    client.move(labels["gamma"], 0.125)
    client.wait_for(lambda m: m["type"] == "SceneNodeUpdateMessage" and "buffer" in m["updates"])
    until(lambda: "600 surfels" in panel._status.content)
    assert "name of an export" in panel._notice.content and panel._notice.visible


def test_exports_land_in_their_folder(viewer):
    client, folder = Client(viewer.port), viewer.exports.folder
    labels = client.controls("format", "name", "height", "export")
    client.move(labels["height"], 128)
    client.move(labels["name"], "mine")
    client.move(labels["export"], True)
    notice(client, "wrote")
    assert [file.name for file in folder.iterdir()] == ["mine.png"]
    assert [file.name for file in folder.parent.iterdir()] == ["exports"]
    client.close()


def test_paths_of_the_page_do_not_leave_its_folder(viewer):
    import http.client

    for path in (
        "/../../../../etc/passwd",
        "/%2e%2e/%2e%2e/%2e%2e/etc/passwd",
        "/..%5c..%5cetc/passwd",
        "//etc/passwd",
    ):
        connection = http.client.HTTPConnection("127.0.0.1", viewer.port, timeout=10)
        connection.request("GET", path)
        assert connection.getresponse().status == 404
        connection.close()


@pytest.mark.parametrize("upgrade", [False, True], ids=["page", "socket"])
@pytest.mark.parametrize(
    "host", ["localhost", "LocalHost.", "127.0.0.1", "[::1]", "[0:0:0:0:0:0:0:1]", "localhost:9000", "127.0.0.1:1"]
)
def test_its_own_names_are_answered_at_any_port(viewer, host, upgrade):
    """Of a tunnel through ssh, the port differs from that of the server."""
    origin = f"http://{host}".lower()
    assert answer_to(viewer.port, host=host, origin=origin, upgrade=upgrade) == (101 if upgrade else 200)


@pytest.mark.parametrize("upgrade", [False, True], ids=["page", "socket"])
@pytest.mark.parametrize(
    "host",
    ["evil.example", "evil.example:18080", "localhost.evil.example", "127.0.0.1.evil.example", "8.8.8.8", "[::2]",
     "localhost@evil.example", "127.0.0.2", "0.0.0.0", "", "[", "localhost:port", None],
)  # fmt: skip
def test_other_names_are_turned_away(viewer, host, upgrade):
    """A site whose name was pointed at this machine got the surfels, and could write exports (DNS rebinding)."""
    assert answer_to(viewer.port, host=host, upgrade=upgrade) == 403
    if host:
        assert answer_to(viewer.port, host=host, origin=f"http://{host}", upgrade=upgrade) == 403


@pytest.mark.parametrize(
    "origin",
    ["http://evil.example", "null", "", "http://[", "http://", "file://", "http://localhost:1", "http://localhost@evil.example",
     "http://localhost evil.example", "https://localhost.evil.example"],
)  # fmt: skip
def test_pages_of_other_sites_are_turned_away(viewer, origin):
    assert answer_to(viewer.port, host=f"localhost:{viewer.port}", origin=origin, upgrade=True) == 403
    friend = Client(viewer.port, additional_headers={"Origin": f"http://127.0.0.1:{viewer.port}"})
    friend.control("gamma")
    friend.close()


def test_malformed_handshakes_keep_no_place(viewer, monkeypatch):
    """After 64 handshakes with a broken Origin, and after any error on the way to a client, new ones must get in."""
    monkeypatch.setattr(admission, "MAX_CLIENTS", 4)
    for origin in ("http://[", "http://[::1", "\x80", "http://localhost:99999999"):
        for _ in range(3):
            assert answer_to(viewer.port, host="localhost", origin=origin, upgrade=True) == 403
    with monkeypatch.context() as broken:
        broken.setattr(server, "restrict_messages", None)
        for _ in range(6):
            with pytest.raises(ConnectionClosed):
                Client(viewer.port).receive(5.0)
    client = Client(viewer.port)
    client.control("gamma")


def test_connections_that_say_nothing_are_ended(viewer, monkeypatch):
    monkeypatch.setattr(admission, "SILENCE_SECONDS", 1.0)
    with pytest.raises(ConnectionClosed, match="not reported its camera"):
        silent = Client(viewer.port, camera={"type": "GuiUpdateMessage", "uuid": "x", "updates": {"value": 1}})
        for _ in range(200):
            silent.receive(5.0)
    client = Client(viewer.port)
    client.control("gamma")
    time.sleep(1.2)
    client.move(client.control("divider"), 0.25)


def test_fifty_clients_and_one_that_stops_reading(viewer):
    before = psutil.Process().memory_info().rss
    clients = [Client(viewer.port) for _ in range(50)]
    controls = [client.controls("gamma", "mode") for client in clients]
    silent = clients[0]
    silent.move(controls[0]["mode"], "exact")
    for i in range(120):
        silent.move(controls[0]["gamma"], 0.001 * i)
        time.sleep(0.005)
    for client, labels in zip(clients[1:], controls[1:], strict=True):
        client.move(labels["gamma"], 0.2)
    for client in clients[1:]:
        client.wait_for(lambda m: m["type"] == "SceneNodeUpdateMessage" and "buffer" in m["updates"])
    until(lambda: viewer.num_clients >= 50)
    buffers = [state.message_buffer for state in viewer._server._websock_server._client_state_from_id.values()]
    assert max(len(buffer.message_from_id) for buffer in buffers) < 400
    assert psutil.Process().memory_info().rss - before < 400 << 20
    for client in clients:
        client.socket.close_socket() if client is silent else client.close()


def test_more_clients_than_a_server_takes(viewer, monkeypatch):
    monkeypatch.setattr(admission, "MAX_CLIENTS", 2)
    clients = [Client(viewer.port) for _ in range(2)]
    with pytest.raises(InvalidStatus, match="503"):
        Client(viewer.port)
    clients[0].control("gamma")
    clients[1].close()
    until(lambda: viewer.num_clients == 1)
    Client(viewer.port).control("gamma")
