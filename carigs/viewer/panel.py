"""The controls of one client on its page, and what its page shows (viser)."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

import numpy as np
import viser
from jaxtyping import Float, Float32, UInt8, UInt32

from carigs.errors import CarigsError
from carigs.viewer.camera_pyramids import CameraPyramids
from carigs.viewer.drives import CAPTURED
from carigs.viewer.exact_mode import View, page_pose, pixels
from carigs.viewer.exports import FORMATS
from carigs.viewer.options import MODES, OVERLAYS, SPLITS
from carigs.viewer.session import Session
from carigs.viewer.splat_records import RECORD_SIZE
from carigs.viewer.subject import Subject

JPEG_QUALITY = 85
"""Of images while something moves; still ones are PNG."""
MAX_NOTICE = 200
"""Characters of a notice."""
FREE = "free"
"""Name of the view that the mouse turns."""
HELP = {
    "mode": "splats: drawn by the browser, follows at once. exact: rendered on the server, as in the figures",
    "divider": "left: the sliders; right: the other variant",
    "motion": "what moves the head: the capture, or a motion of --motion, or one that is built in",
    "store": "keep the values of the sliders as the variant of 'stored values'",
    "frame": "expression and pose of the capture; the sliders below are added",
    "name": "of the file in the export folder: letters, digits, dots, - and _",
}
log = logging.getLogger(__name__)


class Panel:
    """One client's page.

    Attributes:
        session: State of the client.
    """

    def __init__(self, client: viser.ClientHandle, subject: Subject, changed: Callable[[], None]) -> None:
        """Build the page.

        Args:
            client: The client.
            subject: The avatars.
            changed: Called when there is something to do for the session.
        """
        self._client, self._subject, self._changed = client, subject, changed
        self.session = Session(subject, self)
        self.session.state.start(subject.avatar.gamma)  # what visitors came for
        self.on_export: Callable[[Panel, str, str, float], None] = lambda panel, format, name, height: None
        """Called with the panel, the format, the name and the height of an export."""
        self._sliders: dict[str, Any] = {}
        self._splats = self._mesh = None
        self._captured: Any = None
        with client.atomic():
            self._build()
        client.camera.on_update(self._camera_moved)
        self._take_view(client.camera)

    # What the session shows.

    def show_splats(self, records: UInt32[np.ndarray, "n 8"] | None) -> None:
        """Show splats.

        Args:
            records: Records of `splat_records`; None for none.
        """
        if records is None:
            if self._splats is not None:
                self._splats.visible = False
            return
        if self._splats is None:
            count = len(records)
            self._splats = self._client.scene.add_gaussian_splats(
                "/head", np.zeros((count, 3)), np.zeros((count, 3, 3)), np.zeros((count, 3)), np.zeros((count, 1))
            )
        self._splats.buffer = records
        self._splats.visible = True

    def show_image(self, image: UInt8[np.ndarray, "h w 3"] | None, lossless: bool) -> None:
        """Show an image behind the scene.

        Args:
            image: RGB from 0 to 255; None for none.
            lossless: Whether its pixels must arrive as they are.
        """
        self._client.scene.set_background_image(
            image, format="png" if lossless else "jpeg", jpeg_quality=None if lossless else JPEG_QUALITY
        )
        self._client.flush()

    def show_mesh(self, vertices: Float[np.ndarray, "v 3"] | None) -> None:
        """Show the mesh.

        Args:
            vertices: Positions in units of the page; None to hide it.
        """
        if vertices is None:
            if self._mesh is not None:
                self._mesh.visible = False
            return
        if self._mesh is None:
            faces = self._subject.avatar.avatar.sequence.head.faces
            self._mesh = self._client.scene.add_mesh_simple(
                "/mesh", vertices.astype(np.float32), faces.astype(np.uint32), color=(40, 230, 50), wireframe=True,
                cast_shadow=False, receive_shadow=False,
            )  # fmt: skip
        self._mesh.vertices = vertices.astype(np.float32)
        self._mesh.visible = True

    def show_captured(self, image: Float32[np.ndarray, "h w 3"] | None) -> None:
        """Show a captured image beside ours.

        Args:
            image: RGB in [0, 1]; None for none.
        """
        if self._captured is None:
            return
        self._captured.visible = image is not None
        if image is not None:
            self._captured.image = pixels(image[:: max(image.shape[0] // 400, 1), :: max(image.shape[0] // 400, 1)])

    def show_status(self, text: str) -> None:
        """Show the status line.

        Args:
            text: The line.
        """
        self._status.content = text

    def show_notice(self, text: str) -> None:
        """Show what went wrong, or what was written. It stays until the next notice, whatever the status line says.

        Args:
            text: One line, which is cut at `MAX_NOTICE` characters.
        """
        self._notice.content, self._notice.visible = text[:MAX_NOTICE], True

    def show_state(self) -> None:
        """Set the controls of the page to the values and options of the session."""
        values, options = self.session.state.values, self.session.options
        for name, slider in self._sliders.items():
            slider.value = int(values[name]) if name == "frame" else values[name]
        self._camera.value = FREE if options.camera is None else str(options.camera)
        self._show_hint()

    def show_frame(self, frame: int) -> None:
        """Move the slider of the timestep while the capture is played.

        Args:
            frame: Position of the timestep.
        """
        self._sliders["frame"].value = frame

    # Building.

    def _build(self) -> None:
        gui, avatar = self._client.gui, self._subject.avatar
        self._status, self._notice = gui.add_markdown("starting"), gui.add_markdown("", visible=False)
        self._mode = self._option(gui.add_dropdown("mode", MODES, hint=HELP["mode"]), "mode")
        with gui.add_folder("Exaggeration"):
            self._add_sliders("exaggeration")
            self._hint = gui.add_markdown(
                f"**beyond {avatar.gamma:g}** the avatar was not trained: shapes are extrapolated", visible=False
            )
            row = gui.add_button_group("history", ("undo", "redo", "reset"))
            row.on_click(self._guard(lambda: self._history(row.value)))
            with gui.add_folder("Regions (added)", expand_by_default=False):
                self._add_sliders("regions")
        with gui.add_folder("Time"):
            names = (CAPTURED, *(drive.name for drive in self._subject.scenes[0].drives))
            self._motion = self._option(gui.add_dropdown("motion", names, hint=HELP["motion"]), "motion")
            self._add_sliders("time")
            self._playing = self._option(gui.add_checkbox("play", False), "playing")
            self._speed = self._option(gui.add_slider("speed", 0.1, 4.0, 0.1, 1.0), "speed")
        with gui.add_folder("Expression (added)", expand_by_default=False):
            self._add_sliders("expression")
        with gui.add_folder("Neck, jaw, eyes (degrees, added)", expand_by_default=False):
            self._add_sliders("joints")
        self._build_view()
        self._build_exports()

    def _build_view(self) -> None:
        gui = self._client.gui
        splits = [name for name in SPLITS if name != "second avatar" or len(self._subject.scenes) > 1]
        if self._subject.capture is None:
            splits.remove("captured image")
        with gui.add_folder("View"):
            if seen := self._subject.avatar.avatar.seen:
                gui.add_markdown(f"In training, {seen}.")
            self._overlay = self._option(gui.add_dropdown("overlay", OVERLAYS), "overlay")
            self._split = self._option(gui.add_dropdown("compare with", splits), "split")
            self._divider = self._option(gui.add_slider("divider", 0, 1, 0.01, 0.5, hint=HELP["divider"]), "divider")
            gui.add_button("store values", hint=HELP["store"]).on_click(self._guard(self.session.store))
            cameras = [FREE, *map(str, self._subject.cameras)]
            self._camera = gui.add_dropdown("camera", cameras, visible=len(cameras) > 1)
            self._camera.on_update(self._guard(lambda: self._choose_camera(self._camera.value)))
            if self._subject.capture is not None:
                pyramids = CameraPyramids(self._client, self._subject.cameras, self._guard, self._choose_camera)
                shown = gui.add_checkbox("show cameras", False)
                shown.on_update(self._guard(lambda: pyramids.show(bool(shown.value))))
                self._captured = gui.add_image(np.zeros((4, 4, 3), np.uint8), label="captured", visible=False)

    def _build_exports(self) -> None:
        gui = self._client.gui
        with gui.add_folder("Export", expand_by_default=False):
            self._format = gui.add_dropdown("format", tuple(FORMATS))
            self._name = gui.add_text("name", "head", hint=HELP["name"])
            self._height = gui.add_slider("height", 128, 2160, 2, 720)
            gui.add_button("export").on_click(self._guard(self._export))
            gui.add_button("screenshot").on_click(self._guard(self._screenshot))

    def _add_sliders(self, group: str) -> None:
        for control in self._subject.controls:
            if control.group != group:
                continue
            low, high, step = control.low, control.high, control.step
            start = self.session.state.values[control.name]
            if control.name == "frame":
                low, high, step, start = 0, max(int(high), 1), 1, 0
            gamma = self._subject.avatar.gamma
            marks = ((gamma, f"{gamma:g}"),) if group == "exaggeration" else None
            slider = self._client.gui.add_slider(
                control.label, low, high, step, start, marks=marks, hint=HELP.get(control.name)
            )
            slider.on_update(self._guard(lambda name=control.name, slider=slider: self._slid(name, slider.value)))
            self._sliders[control.name] = slider

    # Events. They run in the server's thread, and only note what has changed.

    def _guard(self, action: Callable[[], None]) -> Callable:
        """Wrap an event: what the server itself caused is ignored, and errors become a line on the page."""

        async def handle(event: Any) -> None:
            if getattr(event, "client_id", 0) is None:
                return
            try:
                action()
            except CarigsError as error:
                self.show_notice(str(error))
            except Exception as error:  # a hostile client can set a control to a value of any type
                log.debug("event refused", exc_info=error)
            self._changed()

        return handle

    def _option(self, handle: Any, name: str) -> Any:
        handle.on_update(self._guard(lambda: self.session.set_options(**{name: handle.value})))
        return handle

    def _slid(self, name: str, value: float) -> None:
        self.session.set_value(name, value)
        self._show_hint()

    def _show_hint(self) -> None:
        level, gamma = self.session.state.values["level"], self._subject.avatar.gamma
        self._hint.visible = bool(abs(level) > abs(gamma) + 1e-9)

    def _history(self, what: str) -> None:
        if what == "reset":
            self.session.reset()
        else:
            self.session.undo(again=what == "redo")

    def _choose_camera(self, name: str) -> None:
        number = int(name) if name != FREE else None
        self.session.set_options(camera=number)
        self._camera.value = name
        if number is None:
            return
        camera = self._subject.camera_at(number, self.session.state.values)
        wxyz, position, fov = page_pose(camera)
        with self._client.atomic():
            self._client.camera.position, self._client.camera.fov = position, fov
            self._client.camera.wxyz = wxyz

    def _export(self) -> None:
        self.on_export(self, self._format.value, self._name.value, self._height.value)

    def _screenshot(self) -> None:
        self.on_export(self, next(iter(FORMATS)), "screenshot", self._height.value)

    async def _camera_moved(self, camera: viser.CameraHandle) -> None:
        self._take_view(camera)

    def _take_view(self, camera: viser.CameraHandle) -> None:
        wxyz, position = tuple(np.asarray(camera.wxyz).tolist()), tuple(np.asarray(camera.position).tolist())
        self.session.set_view(View(wxyz, position, camera.fov, camera.image_width, camera.image_height))
        self._changed()


assert RECORD_SIZE == 8  # of viser's buffer
