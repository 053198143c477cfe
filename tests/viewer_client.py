"""A client of the viewer without a browser: viser's messages over a raw websocket."""

from __future__ import annotations

import socket
import time
from typing import Any, ClassVar

import msgspec
import viser
import zstandard
from websockets.sync.client import connect

CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": (0.0, 1.0, 0.0, 0.0),  # looks along -z, y up
    "position": (0.0, 0.0, 10.0),
    "fov": 0.6,
    "near": 0.1,
    "far": 1000.0,
    "image_height": 120,
    "image_width": 160,
    "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 1.0, 0.0),
}


def answer_to(port: int, *, host: str | None, origin: str | None = None, upgrade: bool = False) -> int:
    """Status of the answer to a request with these headers; None leaves one out."""
    headers = {"Host": host, "Origin": origin}
    if upgrade:
        headers |= {"Connection": "Upgrade", "Upgrade": "websocket"}
        headers |= {"Sec-WebSocket-Version": "13", "Sec-WebSocket-Key": "x" * 22 + "=="}
        headers |= {"Sec-WebSocket-Protocol": f"viser-v{viser.__version__}"}
    lines = ["GET / HTTP/1.1", *(f"{name}: {value}" for name, value in headers.items() if value is not None), "", ""]
    with socket.create_connection(("127.0.0.1", port), timeout=10) as connection:
        connection.sendall("\r\n".join(lines).encode("latin1"))
        return int(connection.recv(100).split()[1])


class Client:
    """Keeps the messages that it was sent.

    Attributes:
        opened: All clients that were opened.
    """

    opened: ClassVar[list[Client]] = []

    def __init__(self, port: int, *, camera: dict[str, Any] | None = None, **options: Any) -> None:
        protocol = f"viser-v{viser.__version__}"
        self.socket = connect(f"ws://127.0.0.1:{port}", subprotocols=[protocol], max_size=None, **options)
        self.opened.append(self)
        self.messages: list[dict[str, Any]] = []
        self.buffers: list[list[bytes]] = []
        self.send(CAMERA if camera is None else camera)

    def send(self, message: dict[str, Any]) -> None:
        self.socket.send(msgspec.msgpack.encode(message))

    def receive(self, seconds: float = 10.0) -> None:
        """Take one window of messages."""
        data = self.socket.recv(timeout=seconds)
        size = int.from_bytes(data[8:16], "little")
        content = msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(data[16 : 16 + size]))
        position, buffers = 16 + size, []
        for length in content["binaryBufferLengths"]:
            position += -position % 8
            buffers.append(data[position : position + length])
            position += length
        for message in content["messages"]:
            self.messages.append(message)
            self.buffers.append(buffers)

    def wait_for(self, wanted: Any, seconds: float = 90.0) -> dict[str, Any]:
        """The next message that `wanted` holds for; those before it are forgotten."""
        end = time.monotonic() + seconds
        while True:
            while self.messages:
                message, buffers = self.messages.pop(0), self.buffers.pop(0)
                if wanted(message):
                    return {**message, "buffers": buffers}
            assert time.monotonic() < end, "the message did not come"
            self.receive(end - time.monotonic())

    def control(self, label: str) -> str:
        """Identifier of a control by its label."""
        found = self.wait_for(lambda m: "uuid" in m and m.get("props", {}).get("label") == label)
        return found["uuid"]

    def controls(self, *labels: str) -> dict[str, str]:
        """Identifiers of controls by label, in any order."""
        found: dict[str, str] = {}
        while set(found) != set(labels):
            message = self.wait_for(lambda m: "uuid" in m and m.get("props", {}).get("label") in labels)
            found[message["props"]["label"]] = message["uuid"]
        return found

    def move(self, uuid: str, value: Any) -> None:
        """Set the value of a control."""
        self.send({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value}})

    def image(self, *, lossless: bool = True, seconds: float = 90.0) -> bytes:
        """The next image of exact mode."""
        kind = "png" if lossless else "jpeg"
        found = self.wait_for(
            lambda m: m["type"] == "BackgroundImageMessage" and m["rgb_data"] is not None and m["format"] == kind,
            seconds,
        )
        return found["rgb_data"]

    def close(self) -> None:
        self.socket.close()
