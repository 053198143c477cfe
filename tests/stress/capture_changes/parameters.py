"""Damages of the head parameters of timesteps."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import pairwise

import numpy as np

from stress.capture_changes.edits import edit_parameters
from stress.capture_changes.folder import Change, Folder, swap_files


def damages() -> Iterator[tuple[str, Change]]:
    """Damages of the files of head parameters.

    Yields:
        Name and change.
    """
    yield "expressions of 1e6", partial(edit_parameters, expr=lambda x: x * 0 + 1e6)
    yield "an expression times 12", partial(edit_parameters, where="00007", expr=lambda x: 12 * x)
    yield "a rotation of 45 rad", partial(edit_parameters, where="00007", rotation=lambda x: x * 0 + 45 / np.sqrt(3))
    yield (
        "rotations in degrees",
        partial(edit_parameters, rotation=np.degrees, neck_pose=np.degrees, jaw_pose=np.degrees),
    )
    yield "a neck is turned by 2 rad", partial(edit_parameters, where="00007", neck_pose=lambda x: x * 0 + [0, 2, 0])
    yield (
        "a rotation is 8 degrees off",
        partial(edit_parameters, where="00007", rotation=lambda x: x + np.radians([[0, 8, 0]])),
    )
    yield "a translation of 1e30", partial(edit_parameters, where="00007", translation=lambda x: x * 0 + 1e30)
    yield "translations in millimetres", partial(edit_parameters, translation=lambda x: 1000 * (x + 0.01))
    yield "all translations are 4 cm off", partial(edit_parameters, translation=lambda x: x + np.array([0.04, 0, 0]))
    yield (
        "a translation is 2 cm off",
        partial(edit_parameters, where="00007", translation=lambda x: x + np.array([0.02, 0, 0])),
    )
    yield "a translation is not a number", partial(edit_parameters, where="00007", translation=lambda x: x * np.nan)
    yield "a timestep has another shape", partial(edit_parameters, where="00007", shape=lambda x: x + 0.1)
    yield (
        "static offsets in millimetres",
        lambda f: edit_parameters(f, static_offset=lambda x: x + 20 * np.sin(np.arange(x.size)).reshape(x.shape)),
    )
    yield "two parameter files are swapped", partial(swap_files, a="flame_param/00004.npz", b="flame_param/00020.npz")
    yield (
        "two neighbouring parameter files are swapped",
        partial(swap_files, a="flame_param/00004.npz", b="flame_param/00005.npz"),
    )
    yield "parameter files are late by a timestep", _shift_parameters


def _shift_parameters(folder: Folder) -> None:
    files = sorted((folder.root / "flame_param").iterdir())
    for a, b in pairwise(files):
        swap_files(folder, f"flame_param/{a.name}", f"flame_param/{b.name}")
