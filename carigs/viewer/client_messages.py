"""What a client may send: viser trusts its clients, this server does not.

By its messages a client of viser can open a public tunnel to the server, store uploads of any size, have the server
repeat messages to all other clients and keep them, and set any attribute of a control. Here a connection keeps the
handlers of three kinds of messages: its camera, the value of a control, and a click in the scene. viser has no
settings for this, so private attributes of its version 1.1 are used; `tests/viewer/test_server.py` holds them to it.
"""

from __future__ import annotations

from typing import Any

from viser import _messages as messages

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


def restrict_messages(socket: Any, connection: Any) -> None:
    """Restrict what a client may send.

    Args:
        socket: Its `ServerConnection` of websockets.
        connection: viser's `WebsockClientConnection`, before its first message is read.
    """
    socket.protocol.max_message_size = MAX_MESSAGE
    for kind in set(connection._incoming_handlers) - set(UNDERSTOOD):
        connection.unregister_handler(kind)
    handlers = connection._incoming_handlers.pop(messages.GuiUpdateMessage)

    async def take_value(client_id: Any, message: messages.GuiUpdateMessage) -> None:
        if set(message.updates) == {"value"} and _is_plain(message.updates["value"]):
            for handler in handlers:
                await handler(client_id, message)

    connection.register_handler(messages.GuiUpdateMessage, take_value)


def _is_plain(value: Any) -> bool:
    return isinstance(value, bool | int | float) or (isinstance(value, str) and len(value) <= MAX_TEXT)
