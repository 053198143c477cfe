"""A gallery of avatars: levels, single regions, and expressions of each, from several sides.

Example:
    python -m evaluation.figures.avatar_gallery gallery.png toy=AVATAR.npz ict_s1=AVATAR.npz
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32

import carigs
from carigs.library import HeadAvatar
from evaluation.command_line import run
from evaluation.figures.sheet import write_sheet

SIZE = 300
"""Height and width of an image in pixels."""
AZIMUTH = 30.0
"""Of the side views in degrees."""
OPEN_JAW = 0.2
"""Rotation of the jaw in radians."""


def gallery_poses(avatar: HeadAvatar) -> dict[str, tuple[Mapping[str, Any], float]]:
    """What a gallery shows of an avatar.

    Args:
        avatar: The avatar.

    Returns:
        By title: controls of `HeadAvatar.pose`, and the azimuth of the camera in degrees. Regions and joints that the
        head lacks are left out.
    """
    gamma = avatar.gamma
    ears = [name for name in ("left_ear", "right_ear") if name in avatar.regions]
    poses: dict[str, tuple[Mapping[str, Any], float]] = {
        "level 0": ({}, AZIMUTH),
        f"level {gamma / 2:g}": ({"level": gamma / 2}, AZIMUTH),
        f"level {gamma:g}": ({"level": gamma}, AZIMUTH),
        "from the front": ({"level": gamma}, 0.0),
    }
    if "nose" in avatar.regions:
        poses["nose alone"] = ({"regions": {"nose": gamma}}, AZIMUTH)
    if ears:
        poses["ears alone"] = ({"regions": dict.fromkeys(ears, gamma)}, 0.0)
    if "jaw" in avatar.joints:
        poses["jaw opened"] = ({"level": gamma, "jaw": [OPEN_JAW, 0.0, 0.0]}, AZIMUTH)
    poses["last timestep"] = ({"level": gamma, "timestep": avatar.timesteps[-1]}, -AZIMUTH)
    return poses


def gallery_images(avatar: HeadAvatar, size: int = SIZE) -> dict[str, Float32[np.ndarray, "s s 3"]]:
    """Render the gallery of an avatar.

    Args:
        avatar: The avatar.
        size: Height and width in pixels.

    Returns:
        Images by title.
    """
    images, margin = {}, size // 8  # an orbit leaves room for all sides of the head
    inside = slice(margin, margin + size)
    for title, (controls, azimuth) in gallery_poses(avatar).items():
        (camera,) = carigs.orbit(avatar, 1, azimuth=azimuth, size=size + 2 * margin)
        images[title] = avatar.render(camera, **controls)[inside, inside]
    return images


def write_gallery(file: Path, avatars: Mapping[str, HeadAvatar], size: int = SIZE) -> None:
    """Write the gallery of several avatars as PNG, a row each.

    Args:
        file: PNG file to write.
        avatars: Avatars by name.
        size: Height and width of an image in pixels.
    """
    shown = {name: gallery_images(avatar, size) for name, avatar in avatars.items()}
    titles = list(dict.fromkeys(title for images in shown.values() for title in images))
    cells = [[images.get(title) for title in titles] for images in shown.values()]
    write_sheet(file, cells, rows=list(shown), columns=titles, title="Avatars", height=size)


def main() -> None:
    """Write a gallery from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path, help="PNG to write")
    parser.add_argument("avatars", nargs="+", metavar="NAME=AVATAR", help="name and file of each avatar")
    arguments = parser.parse_args()
    named = (text.partition("=") for text in arguments.avatars)
    write_gallery(arguments.file, {name: carigs.load(file) for name, _, file in named})


if __name__ == "__main__":
    run(main)
