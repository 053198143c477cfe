"""Chromium without a window: started with a pipe, asked over its DevTools protocol."""

from __future__ import annotations

import base64
import json
import os
import shutil
import signal
import subprocess
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import UInt8

from carigs.errors import CarigsError

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome") or shutil.which("chromium-browser")
"""The program; None where it is not installed."""
OPTIONS = (
    "--headless --no-sandbox --disable-dev-shm-usage --disable-background-networking "
    "--disable-component-update --disable-sync --no-first-run --remote-debugging-pipe"
)
NO_GRAPHICS = "--disable-gpu"
WEBGL = "--use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader"
"""WebGL 2 by software, without a graphics processor."""


class Browser:
    """Chromium, asked over its pipe: JSON messages that end with a zero byte. It finds no host but 127.0.0.1.

    Args:
        profile: Empty folder.
        options: Further options of the command line.

    Raises:
        CarigsError: Chromium is not installed.
    """

    def __init__(self, profile: Path, options: str = NO_GRAPHICS) -> None:
        if CHROMIUM is None:
            raise CarigsError("Chromium is not installed: apt-get install chromium, or its like")
        read_commands, self.commands = os.pipe()
        self.messages, write_messages = os.pipe()
        arguments = [*OPTIONS.split(), *options.split(), f"--user-data-dir={profile}"]
        arguments.append("--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1")
        command = f'exec 3<&{read_commands} 4>&{write_messages}; exec "$@"'
        self.process = subprocess.Popen(
            ["bash", "-c", command, "bash", CHROMIUM, *arguments], pass_fds=(read_commands, write_messages),
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
        )  # fmt: skip
        os.close(read_commands)
        os.close(write_messages)
        self.buffer, self.number, self.session, self.events = b"", 0, None, []

    def __enter__(self) -> Browser:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send a command and wait for its answer; events that come before are kept.

        Args:
            method: Name of the command, such as `Page.navigate`.
            **parameters: Its parameters.

        Returns:
            The result.

        Raises:
            CarigsError: The command failed, or Chromium has ended.
        """
        self.number += 1
        message = {"id": self.number, "method": method, "params": parameters}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.commands, json.dumps(message).encode() + b"\0")
        while True:
            while b"\0" not in self.buffer:
                chunk = os.read(self.messages, 1 << 20)
                if not chunk:
                    raise CarigsError("Chromium has ended")
                self.buffer += chunk
            text, self.buffer = self.buffer.split(b"\0", 1)
            answer = json.loads(text)
            if answer.get("id") == self.number:
                if "error" in answer:
                    raise CarigsError(f"{method}: {answer['error']}")
                return answer["result"]
            self.events.append(answer)

    def open(self, url: str, width: int, height: int) -> None:
        """Open a page in a window of its own, wait until it is loaded, and record what it asks for.

        Args:
            url: Address of the page.
            width: Width of the window in pixels.
            height: Height of the window in pixels.
        """
        self.session = None
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        self.events.clear()
        for domain in ("Network", "Page", "Log", "Runtime"):
            self.call(f"{domain}.enable")
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        self.call("Page.navigate", url=url)
        self.wait_for("document.readyState === 'complete' && location.protocol !== 'about:'")

    def wait_for(self, expression: str, seconds: float = 60.0) -> None:
        """Wait until an expression in the page is true.

        Args:
            expression: JavaScript.
            seconds: Longest time.

        Raises:
            CarigsError: It did not become true.
        """
        end = time.monotonic() + seconds
        while not self.value(expression):
            if time.monotonic() > end:
                raise CarigsError(f"not true within {seconds:g} s in the page: {expression}")
            time.sleep(0.1)

    def value(self, expression: str) -> Any:
        """The value of an expression in the page; of a promise, what it resolves to.

        Args:
            expression: JavaScript.

        Returns:
            The value, if JSON knows its type.

        Raises:
            CarigsError: The expression raised an exception.
        """
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            raise CarigsError(f"exception in the page: {answer['exceptionDetails']}")
        return answer["result"].get("value")

    def press(self, key: str) -> None:
        """Press a key.

        Args:
            key: `ArrowLeft`, `ArrowRight`, `Home` or `End`.
        """
        code = {"ArrowLeft": 37, "ArrowRight": 39, "Home": 36, "End": 35}[key]
        for kind in ("rawKeyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=code)

    def pixels(self) -> UInt8[np.ndarray, "h w 3"]:
        """What the window shows.

        Returns:
            RGB.
        """
        return decoded(self.call("Page.captureScreenshot", format="png")["data"])

    def close(self) -> None:
        """End Chromium and what it has started."""
        os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        os.close(self.commands)
        os.close(self.messages)

    def problems(self) -> list[dict[str, Any]]:
        """Errors in the console, and exceptions.

        Returns:
            Those so far.
        """
        logged = [event["entry"] for event in self.named("Log.entryAdded") if event["entry"]["level"] == "error"]
        console = [event for event in self.named("Runtime.consoleAPICalled") if event["type"] == "error"]
        return [*logged, *console, *self.named("Runtime.exceptionThrown")]

    def schemes(self) -> set[str]:
        """Kinds of addresses that were asked for.

        Returns:
            Those so far, such as `file` and `data`.
        """
        return {event["request"]["url"].split(":")[0] for event in self.named("Network.requestWillBeSent")}

    def named(self, event: str) -> list[dict[str, Any]]:
        """The events of a kind.

        Args:
            event: Its name, such as `Network.requestWillBeSent`.

        Returns:
            Their parameters, so far.
        """
        return [message["params"] for message in self.events if message.get("method") == event]


def decoded(encoded: str) -> UInt8[np.ndarray, "h w 3"]:
    """Pixels of an image file in base64.

    Args:
        encoded: The file.

    Returns:
        RGB.
    """
    return cv2.imdecode(np.frombuffer(base64.b64decode(encoded), np.uint8), cv2.IMREAD_COLOR)[:, :, ::-1]
