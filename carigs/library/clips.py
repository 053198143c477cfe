"""Clips of an avatar: its exaggeration grows and falls, the camera goes around, it moves as captured or as driven."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float32
from PIL import Image

from carigs.capture import Camera
from carigs.errors import InputError
from carigs.library.head_avatar import HeadAvatar
from carigs.motion import Motion
from carigs.system.files import writing

VIDEOS, ANIMATIONS = (".mp4", ".webm"), (".gif", ".webp")
CODEC = "vp09"
"""VP9, which browsers, VLC and ffmpeg play, and which needs no licence."""
WEBP_QUALITY = 90


def gamma_sweep(avatar: HeadAvatar, camera: Camera, count: int, level: float, **controls: Any) -> Iterator[np.ndarray]:
    """Exaggeration from 0 to a level and back, slowly at both ends.

    Args:
        avatar: The avatar.
        camera: The view.
        count: Number of images.
        level: The highest level.
        **controls: As of `HeadAvatar.pose`.

    Yields:
        RGB in [0, 1] (h, w, 3).
    """
    for share in 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(count) / count):
        yield avatar.render(camera, level=level * share, **controls)


def turntable(avatar: HeadAvatar, cameras: Sequence[Camera], **controls: Any) -> Iterator[np.ndarray]:
    """The same head from many cameras.

    Args:
        avatar: The avatar.
        cameras: Views, such as those of `carigs.orbit`.
        **controls: As of `HeadAvatar.pose`.

    Yields:
        RGB in [0, 1] (h, w, 3).
    """
    posed = avatar.pose(**controls)
    for camera in cameras:
        yield posed.render(camera)


def captured_sequence(avatar: HeadAvatar, camera: Camera, **controls: Any) -> Iterator[np.ndarray]:
    """The expressions and poses of the capture, in their order.

    Args:
        avatar: The avatar.
        camera: The view.
        **controls: As of `HeadAvatar.pose`, without `timestep`.

    Yields:
        RGB in [0, 1] (h, w, 3).
    """
    for timestep in avatar.timesteps:
        yield avatar.render(camera, timestep=timestep, **controls)


def driven_sequence(avatar: HeadAvatar, camera: Camera, motion: Motion, **controls: Any) -> Iterator[np.ndarray]:
    """The avatar, driven by a motion.

    Args:
        avatar: The avatar.
        camera: The view.
        motion: The motion.
        **controls: As of `HeadAvatar.animate`.

    Yields:
        RGB in [0, 1] (h, w, 3).
    """
    for head in avatar.animate(motion, **controls):
        yield head.render(camera)


def write_clip(file: Path, images: Iterable[Float32[np.ndarray, "h w 3"]], fps: float) -> int:
    """Write images as a clip; its suffix is the format.

    Args:
        file: .mp4 or .webm (VP9), .gif or .webp.
        images: RGB in [0, 1], all of one size.
        fps: Images per second.

    Returns:
        Number of images.

    Raises:
        InputError: If the suffix is another one, or the file cannot be encoded.
    """
    if file.suffix not in VIDEOS + ANIMATIONS:
        raise InputError(f"a clip is one of {', '.join(VIDEOS + ANIMATIONS)}", file=file)
    frames = (np.ascontiguousarray(np.rint(255 * image[..., ::-1].clip(0, 1)).astype(np.uint8)) for image in images)
    with writing(file) as part:
        count = (_write_video if file.suffix in VIDEOS else _write_animation)(part, frames, fps)
        if count == 0 or not part.exists():
            raise InputError(f"{count} images could not be encoded", file=file)
    return count


def _write_video(part: Path, frames: Iterator[np.ndarray], fps: float) -> int:
    video, count = None, 0
    for frame in frames:
        if video is None:
            video = cv2.VideoWriter(str(part), cv2.VideoWriter_fourcc(*CODEC), fps, frame.shape[1::-1])
        video.write(frame)
        count += 1
    if video is not None:
        video.release()
    return count


def _write_animation(part: Path, frames: Iterator[np.ndarray], fps: float) -> int:
    images = [Image.fromarray(frame[..., ::-1]) for frame in frames]
    if images:
        images[0].save(
            part, save_all=True, append_images=images[1:], duration=round(1000 / fps), loop=0, quality=WEBP_QUALITY
        )
    return len(images)
