"""Names of files that belong together: what a dataset and a head model consist of.

Readers open these files, and `carigs.runs.outside_files` looks whether one of them has changed.
"""

import os
from pathlib import Path

SPLITS = ("train", "val", "test")
INDEXES = {split: f"transforms_{split}.json" for split in SPLITS}
"""Files that list the frames of a dataset, by split."""
TRUE_FRAMES = "frames.json"
"""File that lists the images of a true caricature."""

MASKS, UV_MASKS, UV_MESH = "FLAME_masks.pkl", "uv_masks.npz", "head_template_mesh.obj"
LANDMARKS = ("landmark_embedding_with_eyes.npy", "landmark_embedding.npy")
BESIDE_FLAME = (MASKS, UV_MASKS, UV_MESH, *LANDMARKS)
"""What is read beside the pickle of a FLAME model: regions, and points on the surface."""


def with_slashes(name: str, folder: Path) -> str:
    r"""Read a path of an index that a program on Windows may have written: `images\00000.png`.

    Args:
        name: The path, relative to the folder.
        folder: The folder.

    Returns:
        The path with `/` in place of backslashes, unless there is a file with backslashes in its name.
    """
    return name if "\\" not in name or os.path.lexists(folder / name) else name.replace("\\", "/")
