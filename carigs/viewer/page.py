"""What a page can show: the interface between a session and its page."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from jaxtyping import Float, Float32, UInt8, UInt32


class Page(Protocol):
    """What a session shows on its page."""

    def show_splats(self, records: UInt32[np.ndarray, "n 8"] | None) -> None:
        """Show splats.

        Args:
            records: Records of `splat_records`; None for none.
        """

    def show_image(self, image: UInt8[np.ndarray, "h w 3"] | None, lossless: bool) -> None:
        """Show an image behind the scene.

        Args:
            image: RGB from 0 to 255; None for none.
            lossless: Whether its pixels must arrive as they are.
        """

    def show_mesh(self, vertices: Float[np.ndarray, "v 3"] | None) -> None:
        """Show the mesh.

        Args:
            vertices: Positions in units of the page; None to hide it.
        """

    def show_captured(self, image: Float32[np.ndarray, "h w 3"] | None) -> None:
        """Show a captured image beside ours.

        Args:
            image: RGB in [0, 1]; None for none.
        """

    def show_status(self, text: str) -> None:
        """Show the status line.

        Args:
            text: The line.
        """

    def show_state(self) -> None:
        """Set the controls of the page to the values and options of the session."""

    def show_frame(self, frame: int) -> None:
        """Move the slider of the timestep while the capture is played.

        Args:
            frame: Position of the timestep.
        """
