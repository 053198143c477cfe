"""Chromium for tests of pages: started with a pipe, asked over its DevTools protocol."""

from __future__ import annotations

import base64
import json
import os
import shutil
import signal
import subprocess
import time
from pathlib import Path

import cv2
import numpy as np

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome") or shutil.which("chromium-browser")
OPTIONS = (
    "--headless --no-sandbox --disable-dev-shm-usage --disable-background-networking "
    "--disable-component-update --disable-sync --no-first-run --remote-debugging-pipe"
)
NO_GRAPHICS = "--disable-gpu"
WEBGL = "--use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader"
"""WebGL 2 by software, without a graphics processor."""


class Browser:
    """Chromium's DevTools protocol over its pipe: JSON messages that end with a zero byte."""

    def __init__(self, profile: Path, options: str = NO_GRAPHICS) -> None:
        read_commands, self.commands = os.pipe()
        self.messages, write_messages = os.pipe()
        options = [*OPTIONS.split(), *options.split(), f"--user-data-dir={profile}"]
        options.append("--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1")
        command = f'exec 3<&{read_commands} 4>&{write_messages}; exec "$@"'
        self.process = subprocess.Popen(
            ["bash", "-c", command, "bash", CHROMIUM, *options],
            pass_fds=(read_commands, write_messages),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        os.close(read_commands)
        os.close(write_messages)
        self.buffer, self.number, self.session, self.events = b"", 0, None, []

    def call(self, method: str, **parameters) -> dict:
        """Send a command and wait for its answer; events that come before are kept."""
        self.number += 1
        message = {"id": self.number, "method": method, "params": parameters}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.commands, json.dumps(message).encode() + b"\0")
        while True:
            while b"\0" not in self.buffer:
                chunk = os.read(self.messages, 1 << 20)
                assert chunk, "Chromium has ended"
                self.buffer += chunk
            text, self.buffer = self.buffer.split(b"\0", 1)
            answer = json.loads(text)
            if answer.get("id") == self.number:
                assert "error" not in answer, answer
                return answer["result"]
            self.events.append(answer)

    def open(self, page: Path, width: int, height: int) -> None:
        """Open a page in a window, and record what it asks for."""
        self.session = None
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        self.events.clear()
        for domain in ("Network", "Page", "Log", "Runtime"):
            self.call(f"{domain}.enable")
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        self.call("Page.navigate", url=page.as_uri())
        while self.value("document.readyState + location.protocol") != "completefile:":
            time.sleep(0.1)

    def value(self, expression: str):
        """The value of an expression in the page; of a promise, what it resolves to."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def press(self, key: str) -> None:
        """Press a key."""
        code = {"ArrowLeft": 37, "ArrowRight": 39, "Home": 36, "End": 35}[key]
        for kind in ("rawKeyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=code)

    def pixels(self) -> np.ndarray:
        """The window as RGB."""
        return decoded(self.call("Page.captureScreenshot", format="png")["data"])

    def close(self) -> None:
        """End Chromium and what it has started."""
        os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        os.close(self.commands)
        os.close(self.messages)

    def problems(self) -> list[dict]:
        """Errors in the console and exceptions so far."""
        logged = [event["entry"] for event in self.named("Log.entryAdded") if event["entry"]["level"] == "error"]
        console = [event for event in self.named("Runtime.consoleAPICalled") if event["type"] == "error"]
        return [*logged, *console, *self.named("Runtime.exceptionThrown")]

    def schemes(self) -> set[str]:
        """Kinds of addresses that were asked for so far."""
        return {event["request"]["url"].split(":")[0] for event in self.named("Network.requestWillBeSent")}

    def named(self, event: str) -> list[dict]:
        """The events of a kind so far."""
        return [message["params"] for message in self.events if message.get("method") == event]


def decoded(encoded: str) -> np.ndarray:
    """RGB pixels of an image file in base64."""
    return cv2.imdecode(np.frombuffer(base64.b64decode(encoded), np.uint8), cv2.IMREAD_COLOR)[:, :, ::-1]
