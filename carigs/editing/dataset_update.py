"""Iterative dataset update (Haque et al. 2023): frames are edited one after the other while the avatar is trained."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, UInt8

from carigs.capture import Capture, Frame
from carigs.editing.edit_steps import first_edit, last_edit
from carigs.editing.editor import make_editor
from carigs.editing.region_mask import confined, edited_faces, edited_pixels
from carigs.editing.view import Editor, ViewToEdit
from carigs.errors import InputError
from carigs.readers.arrays import checked_array
from carigs.settings import Edit

_SAVED = "edited_frame_"


class DatasetUpdate:
    """The frames that edits have replaced, and which view is edited when.

    Every `every` steps one training view is rendered, edited, and takes the place of its frame. Views come in epochs:
    every one once in random order before any comes again.

    Args:
        settings: Section `train.edit`; its editor is not `none`.
        capture: The subject.
        seed: Seed of the training.
        from_avatar: Whether the training starts from an avatar.
        editor: What edits a view; None for the one that settings name.

    Raises:
        WeightsMissing: As `make_editor`.
        SettingsError: As `make_editor`, and for regions that the head model lacks.
        InputError: As `make_editor`.
    """

    def __init__(
        self, settings: Edit, capture: Capture, seed: int, *, from_avatar: bool = False, editor: Editor | None = None
    ) -> None:
        self.settings, self.capture, self.seed, self.from_avatar = settings, capture, seed, from_avatar
        self.frames = capture.split("train")
        self.faces = edited_faces(capture.model, settings.regions)
        self.images: dict[int, UInt8[np.ndarray, "h w 3"]] = {}
        self._editor = editor or make_editor(settings, capture, seed)

    def begin(self, iterations: int) -> int:
        """The first step with an edit.

        Args:
            iterations: Steps of the training.

        Returns:
            Its number.
        """
        return first_edit(iterations, self.from_avatar)

    def progress(self, i: int, iterations: int) -> float:
        """How far the learning rates have fallen: they start anew with the edits, as for an avatar that is complete.

        Args:
            i: The step.
            iterations: Steps of the training.

        Returns:
            0 at the first step of the real frames and of the edits, 1 at the last one of each.
        """
        first = self.begin(iterations)
        start, end = (0, first) if i < first else (first, iterations)
        return (i - start) / max(1, end - start - 1)

    def due(self, i: int, iterations: int) -> int | None:
        """The view that is edited before a step.

        Args:
            i: The step.
            iterations: Steps of the training.

        Returns:
            Index of its training frame; None if none is edited.
        """
        first = self.begin(iterations)
        if not first <= i < last_edit(iterations, self.from_avatar) or (i - first) % self.settings.every:
            return None
        epoch, place = divmod((i - first) // self.settings.every, len(self.frames))
        return int(np.random.default_rng([self.seed, 3, epoch]).permutation(len(self.frames))[place])

    def frozen(self, kept: Bool[np.ndarray, " f"] | None) -> Bool[np.ndarray, " f"] | None:
        """Triangles whose surfels stay as they are from the first edit on.

        Args:
            kept: Triangles whose surfels stay as they are in any case.

        Returns:
            Those, and all outside the regions of the edits.
        """
        if self.faces is None:
            return kept
        return ~self.faces if kept is None else kept | ~self.faces

    def update(
        self,
        i: int,
        index: int,
        vertices: Float[np.ndarray, "v 3"],
        render: Callable[[Frame], Float[np.ndarray, "h w 3"]],
    ) -> None:
        """Edit a view and replace its frame.

        Args:
            i: The step, for the seed.
            index: Index of the training frame.
            vertices: The natural head at its timestep, in world coordinates and metres.
            render: Renders the avatar as it is in the view of a frame, at level 0.
        """
        frame = self.frames[index]
        camera, weight = self.capture.camera(frame), None
        if self.faces is not None:
            weight = edited_pixels(self.capture.model, vertices, camera, self.faces)
            if not weight.any():  # this view shows nothing that may change
                return
        captured = self.capture.image(frame)
        rendered = np.asarray(render(frame), np.float32).clip(0, 1)
        edited = self._editor(ViewToEdit(frame, captured, rendered, camera, vertices, (self.seed, i, index)))
        if weight is not None:
            edited = confined(edited, captured, weight)
        stored = np.rint(255 * edited.clip(0, 1)).astype(np.uint8)
        self.images[index] = np.ascontiguousarray(stored.transpose(2, 0, 1)).transpose(1, 2, 0)

    def as_arrays(self) -> dict[str, np.ndarray]:
        """The state, for a checkpoint.

        Returns:
            Arrays by name.
        """
        return {f"{_SAVED}{index}": image for index, image in self.images.items()}

    def restore(self, arrays: Mapping[str, Any]) -> None:
        """Set the state to that of a checkpoint.

        Args:
            arrays: Arrays of `as_arrays` among others.

        Raises:
            InputError: An array is not valid.
        """
        self.images = {}
        for name in arrays:
            if not name.startswith(_SAVED):
                continue
            index = int(name[len(_SAVED) :])
            if not 0 <= index < len(self.frames):
                raise InputError(f"there is no training frame {index}", file="checkpoint", field=name)
            camera = self.capture.camera(self.frames[index])
            image = checked_array(arrays, name, (camera.height, camera.width, 3), np.uint8, file="checkpoint")
            self.images[index] = np.ascontiguousarray(image.transpose(2, 0, 1)).transpose(1, 2, 0)
