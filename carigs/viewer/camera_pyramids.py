"""The cameras of the capture as pyramids in the scene, which a click looks through."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import viser

from carigs.capture import Camera
from carigs.viewer.exact_mode import page_pose
from carigs.viewer.splat_records import SCENE_SCALE

LENGTH = 0.03
"""From the centre of a camera to the base of its pyramid in metres."""
LINE_WIDTH = 1.5
"""In pixels."""
COLOUR = (70, 110, 160)
"""sRGB from 0 to 255."""


class CameraPyramids:
    """The pyramids of one client's page, hidden at first."""

    def __init__(
        self,
        client: viser.ClientHandle,
        cameras: Mapping[int, Camera],
        guard: Callable[[Callable[[], None]], Callable],
        choose: Callable[[str], None],
    ) -> None:
        """Add them to the page.

        Args:
            client: The client.
            cameras: The cameras by number.
            guard: Makes a handler of viser's events from an action.
            choose: Called with the number of the camera whose pyramid was clicked.
        """
        self._pyramids: list[Any] = []
        for number, camera in cameras.items():
            wxyz, position, fov = page_pose(camera)
            pyramid = client.scene.add_camera_frustum(
                f"/cameras/{number}", fov, camera.width / camera.height, scale=LENGTH * SCENE_SCALE,
                thickness=LINE_WIDTH, thickness_units="screen", color=COLOUR,
                wxyz=wxyz, position=position, visible=False,
            )  # fmt: skip
            pyramid.on_click(guard(lambda number=number: choose(str(number))))
            self._pyramids.append(pyramid)

    def show(self, visible: bool) -> None:
        """Show or hide all.

        Args:
            visible: Whether to show them.
        """
        for pyramid in self._pyramids:
            pyramid.visible = visible
