"""An avatar as glTF with joints, morph targets, animations and colours."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from carigs.errors import SettingsError
from carigs.head import HeadModel
from carigs.library.driving import driven_parameters
from carigs.library.head_avatar import HeadAvatar
from carigs.motion import Motion

if TYPE_CHECKING:
    from carigs.splat.formats.animated_head import HeadClip

REGIONS = ("nose", "lips", "left_ear", "right_ear", "forehead", "eye_region")
"""Regions that become morph targets, where the head has them."""


def write_animated(
    avatar: HeadAvatar,
    file: str | Path,
    *,
    level: float | None = None,
    motions: Mapping[str, Motion] | None = None,
    driver: HeadModel | None = None,
) -> None:
    """Write the mesh of an avatar with everything that moves it, for Blender, three.js and game engines.

    Args:
        avatar: The avatar.
        file: Path to write: .glb or .gltf.
        level: Exaggeration; None for the highest of the avatar.
        motions: Animations by name; None for the capture.
        driver: Head model that the motions belong to, if names do not suffice.

    Raises:
        SettingsError: If a motion cannot be transferred.
    """
    from carigs.splat.formats.animated_head import HeadClip

    motions = {"captured": avatar.captured_motion()} if motions is None else motions
    frames = {name: driven_parameters(avatar.avatar.sequence, motion, driver) for name, motion in motions.items()}
    clips = {name: HeadClip(motions[name].fps, parameters) for name, parameters in frames.items()}
    write_clips(avatar, Path(file), avatar.gamma if level is None else level, clips)


def write_clips(avatar: HeadAvatar, file: Path, level: float, clips: Mapping[str, HeadClip]) -> None:
    """Write the mesh as `write_animated`, with animations of this head.

    Args:
        avatar: The avatar.
        file: Path to write: .glb or .gltf.
        level: Exaggeration.
        clips: Animations by name.
    """
    from carigs.splat.formats.animated_head import write_animated_head
    from carigs.splat.formats.baked_colours import baked_colours

    sequence, regions = avatar.avatar.sequence, {}
    for name in (name for name in REGIONS if name in avatar.regions):
        with contextlib.suppress(SettingsError):  # a region that cannot be exaggerated alone is no morph target
            regions[name] = avatar.region_path(name)
    colours = baked_colours(avatar.avatar, sequence.posed(min(sequence.parameters), level))
    write_animated_head(file, sequence, level, clips, colours, regions)
