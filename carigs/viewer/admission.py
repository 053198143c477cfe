"""What a client may send: viser trusts its clients, this server does not.

By its messages a client of viser can open a public tunnel to the server, store uploads of any size, have the server
repeat messages to all other clients and keep them, and set any attribute of a control. Here a connection keeps the
handlers of three kinds of messages: its camera, the value of a control, and a click in the scene. viser has no
settings for this, so private attributes of its version 1.1 are used; `tests/viewer/test_server.py` holds them to it.
"""

from __future__ import annotations

from typing import Any
from urllib.parse import urlsplit

from viser import _messages as messages

MAX_CLIENTS = 64
"""Connections at a time; further ones are closed."""
MAX_MESSAGE = 1 << 14
"""Bytes of a message from a client: a browser sends a camera, a click, or the value of a control."""
MAX_TEXT = 100
"""Characters of the value of a control."""
UNDERSTOOD = (messages.ViewerCameraMessage, messages.GuiUpdateMessage, messages.SceneNodeClickMessage)


def forget_shared_handlers(websocket_server: Any) -> None:
    """Remove the handlers of all clients' messages that do not belong to one client.

    Args:
        websocket_server: viser's `WebsockServer`.
    """
    for kind in list(websocket_server._incoming_handlers):
        websocket_server.unregister_handler(kind)


async def admit(websocket_server: Any, connection: Any) -> None:
    """Close a connection that is one too many or comes from another page, and restrict the messages of others.

    A page of any site may open a connection to this server in the browser of its user. Browsers then name the site in
    the header Origin.

    Args:
        websocket_server: viser's `WebsockServer`.
        connection: The connection, before its first message is read.
    """
    socket = websocket_server._live_connections.get(connection.client_id)
    if socket is None:
        return
    socket.protocol.max_message_size = MAX_MESSAGE
    for kind in set(connection._incoming_handlers) - set(UNDERSTOOD):
        connection.unregister_handler(kind)
    handlers = connection._incoming_handlers.pop(messages.GuiUpdateMessage)

    async def take_value(client_id: Any, message: messages.GuiUpdateMessage) -> None:
        if set(message.updates) == {"value"} and _is_plain(message.updates["value"]):
            for handler in handlers:
                await handler(client_id, message)

    connection.register_handler(messages.GuiUpdateMessage, take_value)
    origin, host = socket.request.headers.get("Origin"), socket.request.headers.get("Host", "")
    if origin is not None and urlsplit(origin).netloc != host:
        await socket.close(1008, "this page belongs to another site")
    elif len(websocket_server._live_connections) > MAX_CLIENTS:
        await socket.close(1013, "too many clients")


def _is_plain(value: Any) -> bool:
    return isinstance(value, bool | int | float) or (isinstance(value, str) and len(value) <= MAX_TEXT)
