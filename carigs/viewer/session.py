"""One client: its values and options, and what it must be shown next. Nothing here depends on viser."""

from __future__ import annotations

import threading
import time
from dataclasses import replace
from typing import Any

import numpy as np

from carigs.capture import Camera
from carigs.errors import SettingsError
from carigs.viewer.comparison import composed_image
from carigs.viewer.drives import CAPTURED
from carigs.viewer.exact_mode import Resolution, View, fitted, full_height
from carigs.viewer.options import Options
from carigs.viewer.page import Page
from carigs.viewer.splat_records import SCENE_SCALE, splat_records
from carigs.viewer.state import MOTION, State, Values
from carigs.viewer.subject import Subject

SETTLE_SECONDS = 0.25
"""Time without a change after which the full image is shown."""
BASE_FPS = 24.0
"""Timesteps per second at speed 1."""
FADED = 0.35
"""Factor on opacities that lets the browser's mesh shine through the splats."""
STATUS_SECONDS = 0.25
"""Time between changes of the status line, and of the slider of the timestep while playing."""


class Session:
    """State of a client. Methods of events are called by the server's thread, `step` by the thread that computes.

    Attributes:
        subject: The avatars.
        page: What is shown.
        state: Values of the controls and their history.
        options: What is looked at.
        view: Camera of the browser; None before its first message.
    """

    def __init__(self, subject: Subject, page: Page) -> None:
        """Start with the natural head.

        Args:
            subject: The avatars.
            page: The page of the client.
        """
        self.subject, self.page = subject, page
        self.state, self.options, self.view = State(subject.controls), Options(), None
        self.stored: Values = dict(self.state.values)
        self._lock = threading.RLock()
        self._changed, self._settled, self._settle_at = False, True, 0.0
        self._next_frame, self._arrived = 0.0, False
        self._sent: Any = None
        self._resolution = Resolution()
        self._frame_times: list[float] = []
        self._status_at, self._captured_key = 0.0, None

    def set_value(self, name: str, value: float) -> None:
        """Move a control.

        Args:
            name: Its name.
            value: Its value.

        Raises:
            SettingsError: If there is no such control or value.
        """
        with self._lock:
            self._changed |= self.state.set(name, value, time.monotonic())

    def set_options(self, **changes: Any) -> None:
        """Change options.

        Args:
            **changes: Fields of `Options`.

        Raises:
            SettingsError: If a value is not possible.
        """
        with self._lock:
            options = replace(self.options, **changes)
            if options.split == "second avatar" and len(self.subject.scenes) < 2:
                raise SettingsError("split: there is no second avatar")
            if "camera" in changes:
                if options.camera is not None and options.camera not in self.subject.cameras:
                    raise SettingsError("camera: the capture has no such camera")
                self._arrived = False
            names = [CAPTURED, *(drive.name for drive in self.subject.scenes[0].drives)]
            if options.motion not in names:
                raise SettingsError(f"motion: one of {', '.join(names)}")
            if options.motion != self.options.motion:
                self.state.drive(names.index(options.motion))
            if (options.playing and not self.options.playing) or options.motion != self.options.motion:
                self._next_frame = 0.0
            self._changed |= options != self.options
            self.options = options

    def set_view(self, view: View) -> None:
        """Take the camera of the browser. A client that looked through a camera of the capture leaves it by moving.

        Args:
            view: The camera; one that cannot exist is ignored.
        """
        if not view.is_possible:
            return
        with self._lock:
            self._changed |= view != self.view
            self.view = view
            camera = self.options.camera
            if camera is None:
                return
            rig = self.subject.cameras[camera]
            away = float(np.linalg.norm(np.array(view.position) / SCENE_SCALE - rig.centre))
            if away <= 0.01 * float(np.linalg.norm(rig.centre)) + 1e-3:
                self._arrived = True
            elif self._arrived:
                self.options = replace(self.options, camera=None)
                self.page.show_state()

    def undo(self, *, again: bool = False) -> None:
        """Take the last step back.

        Args:
            again: Whether to repeat a step that was taken back instead.
        """
        with self._lock:
            self._changed |= self.state.redo() if again else self.state.undo()
        self.page.show_state()

    def reset(self) -> None:
        """Show the natural head."""
        with self._lock:
            self.state.reset()
            self._changed = True
        self.page.show_state()

    def store(self) -> None:
        """Keep the values as the variant that a split view compares with."""
        with self._lock:
            self.stored, self._changed = dict(self.state.values), True

    def step(self, now: float) -> float | None:
        """Show what is due.

        Args:
            now: Time in seconds, of `time.monotonic`.

        Returns:
            When the next step is due without another event; None if none is.
        """
        with self._lock:
            self._advance(now)
            values, options, view = self.state.values, self.options, self.view
            changed, self._changed = self._changed, False
        if view is None:
            return None
        if not changed and (self._settled or now < self._settle_at):
            return self._due()
        settled = not changed
        if changed:
            self._settle_at = now + SETTLE_SECONDS
        started = time.perf_counter()
        shown = (self._show_exact if options.is_exact else self._show_splats)(values, options, view, settled)
        self._settled = settled
        self._show_captured(values, options)
        if shown:
            self._show_speed(shown, time.perf_counter() - started, settled)
        return self._due()

    def export_camera(self, height: int) -> Camera:
        """View of the client for pictures and clips.

        Args:
            height: Height in pixels.

        Returns:
            The camera; its width is even, as codecs want it.

        Raises:
            SettingsError: If the browser has not reported its camera, or the height is not possible.
        """
        if self.view is None:
            raise SettingsError("the page has not reported its camera yet")
        if not isinstance(height, int | float) or not 64 <= height <= 2160:
            raise SettingsError("height: expected 64 to 2160 pixels")
        height = 2 * round(height / 2)
        width = min(2 * round(0.5 * height * self.view.width / self.view.height), 4096)
        return self.view._replace(width=width, height=height).camera()

    def _advance(self, now: float) -> None:
        """Go on to the next timestep, or the next frame of the motion, if playing."""
        if not self.options.playing or now < self._next_frame:
            return
        number, frame = (int(self.state.values.get(name, 0)) for name in MOTION)
        fps = self.subject.scenes[0].drives[number - 1].fps if number else BASE_FPS
        period = 1 / (fps * self.options.speed)
        steps = 1 if self._next_frame == 0 else 1 + min(int((now - self._next_frame) / period), 1000)
        if number:
            self.state.drive(number, (frame + steps) % len(self.subject.scenes[0].drives[number - 1].parameters))
        else:
            self.state.play(int(self.state.values["frame"]) + steps)
        self._next_frame = (now if self._next_frame == 0 else self._next_frame) + steps * period
        self._changed = True

    def _due(self) -> float | None:
        if self.options.playing:
            return self._next_frame
        return None if self._settled else self._settle_at

    def _show_splats(self, values: Values, options: Options, view: View, settled: bool) -> str:
        scene = self.subject.scenes[0]
        surfels = scene.avatar.avatar.surfels
        eye = view.camera().centre
        # The view matters to view-dependent colours alone, which follow when the camera is still.
        seen = tuple(np.round(eye, 4)) if surfels.sh_degree > 0 and settled else None
        key = ("splats", values, options.overlay, seen, settled and scene.avatar.avatar.sequence.shading is not None)
        if self._sent == key or (self._sent is not None and not settled and self._sent[:3] == key[:3]):
            return ""
        world = scene.surfels(values, eye, settled=settled, face_colours=self.subject.face_colours(options.overlay))
        if options.overlay == "mesh":
            world.opacity = FADED * world.opacity
        if self._sent is None or self._sent[0] != "splats":
            self.page.show_image(None, lossless=False)
        self.page.show_splats(splat_records(world))
        self.page.show_mesh(SCENE_SCALE * scene.vertices(values) if options.overlay == "mesh" else None)
        self._sent = key
        return f"splats, {len(surfels)} surfels"

    def _show_exact(self, values: Values, options: Options, view: View, settled: bool) -> str:
        key = ("exact", values, options, view, settled, self.stored if options.split == "stored values" else None)
        if self._sent == key:
            return ""
        if self._sent is None or self._sent[0] != "exact":
            self.page.show_splats(None)
            self.page.show_mesh(None)
        camera = view.camera(full_height(view) if settled else self._resolution.height(view))
        rig = None if options.camera is None else self.subject.camera_at(options.camera, values)
        if rig is not None:
            camera = fitted(rig, camera.width, camera.height)
        started = time.perf_counter()
        image, note = composed_image(self.subject, values, self.stored, options, camera, settled=settled)
        self.page.show_image(image, lossless=settled)
        if not settled:
            self._resolution.measured(time.perf_counter() - started, camera.width, camera.height)
        self._sent = key
        return f"exact, {camera.width} x {camera.height}{note}"

    def _show_captured(self, values: Values, options: Options) -> None:
        key = None if options.camera is None else (options.camera, values["frame"])
        if key != self._captured_key and not options.playing:
            self.page.show_captured(None if key is None else self.subject.captured(options.camera, values))
            self._captured_key = key

    def _show_speed(self, what: str, seconds: float, settled: bool) -> None:
        """Write images per second and the server's time per image into the status line."""
        now = time.perf_counter()
        self._frame_times = [t for t in self._frame_times if now - t < 2.0] + [now]
        if not settled and now < self._status_at:
            return
        self._status_at = now + STATUS_SECONDS
        if self.options.playing:
            self.page.show_frame(int(self.state.values["frame"]))
        count = len(self._frame_times) - 1
        fps = count / max(now - self._frame_times[0], 1e-3)
        rate = f", {fps:.0f} images/s" if count > 2 and not settled else ""
        self.page.show_status(f"{what}: {1000 * seconds:.0f} ms{rate}")
