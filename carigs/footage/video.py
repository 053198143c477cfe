"""Videos: decoded twice by a process of its own, first for the times of all frames, then for the chosen frames.

The number of frames in a header is a claim, and often an estimate. The first pass counts what can be decoded.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from carigs.errors import InputError
from carigs.footage import decoder
from carigs.footage.footage import Footage
from carigs.footage.selection import Selection
from carigs.readers.video_header import VideoHeader, read_video_header

MAX_FRAME_PIXELS = 8192 * 4320
"""Most pixels of a frame: 8K."""
MAX_FRAMES = 1 << 20
"""Most frames of a video: five hours at 60 a second."""
MIN_FRAMES = 10
"""Fewest frames of a video: less than half a second."""
LOST_SHARE = 0.03
"""Share of the claimed frames from which missing ones are reported: headers of MKV and AVI round durations."""
VARIABLE_RATE = 1.8
"""Longest interval between frames, in medians, from which the rate is called variable."""
HDR_SINCE = 5
"""Major version of OpenCV whose FFmpeg converts HLG and PQ to sRGB; earlier ones return the coded values."""


class _Answer(NamedTuple):
    """What the decoder says before it sends anything (`decoder.ANSWER`)."""

    width: int
    height: int
    fps: float
    claimed: float
    bits: int


def read_video(file: Path, selection: Selection | None = None) -> Footage:
    """Find the frames of a video.

    Args:
        file: MP4, MOV, MKV, WebM, AVI or GIF.
        selection: Frames that are used, and their size; None for all as they are.

    Returns:
        The footage. Its warnings say what is unusual: frames that are missing, a variable rate, high dynamic range.

    Raises:
        InputError: If the file is no such video, cannot be decoded, or has too few frames.
    """
    file, selection = Path(file), selection or Selection()
    header = read_video_header(file)
    if header.hdr and _opencv_version() < HDR_SINCE:
        remedy = f"install OpenCV {HDR_SINCE}, or convert the video to standard dynamic range"
        raise InputError(
            f"high dynamic range ({header.hdr}), which this OpenCV cannot convert", file=file, remedy=remedy
        )
    with _decoding(file, header, frames=None, size=None) as (answer, stream):
        content = stream.read(8 * MAX_FRAMES + 1)
    if len(content) > 8 * MAX_FRAMES:
        raise InputError(f"more than {MAX_FRAMES} frames", file=file)
    times, warnings = _ascending(np.frombuffer(content, np.float64, len(content) // 8), answer.fps)
    count = len(times)
    lost = answer.claimed - count
    text = f"{count} of {answer.claimed:.0f} frames can be decoded"
    if count < MIN_FRAMES:
        problem = text if lost > 0 else f"{count} frames"
        raise InputError(f"{problem}; at least {MIN_FRAMES} are needed", file=file)
    if lost > max(1, LOST_SHARE * answer.claimed):
        # The last frame before the cut may lack its lower part.
        times, count = times[:-1], count - 1
        warnings.append(f"{text}: the file is cut off or damaged; the first {count} are used")
    intervals = np.diff(times)
    if intervals.max() > VARIABLE_RATE * np.median(intervals):
        shortest, longest = 1000 * intervals.min(), 1000 * intervals.max()
        warnings.append(f"variable frame rate: {shortest:.0f} to {longest:.0f} ms between frames")
    if header.hdr:
        warnings.append(f"high dynamic range ({header.hdr}): what is brighter than white paper is cut off")
    elif answer.bits > 8:
        warnings.append(f"{answer.bits} bits a channel, and no transfer function is named: read as standard range")
    numbers = selection.frames(times)
    if not numbers:
        raise InputError(f"no frames between start and end: it has {times[-1] - times[0]:.1f} s", file=file)
    size = selection.size(answer.width, answer.height)
    return Footage(
        file,
        *size,
        tuple(numbers),
        times[numbers],
        fps=float(1 / np.median(intervals)),
        duration=float(times[-1] - times[0]),
        focal_length=None,
        decode=lambda: _frames(file, header, numbers, size),
        warnings=tuple(f"{file}: {line}" for line in warnings),
    )


def _opencv_version() -> int:
    """Major version."""
    return int(cv2.__version__.split(".")[0])


def _ascending(times: Float[np.ndarray, " n"], fps: float) -> tuple[Float[np.ndarray, " n"], list[str]]:
    """Times that ascend: those of the container, or if they do not ascend, those of a constant rate."""
    if np.isfinite(times).all() and (np.diff(times) > 0).all():
        return times, []
    rate = fps if np.isfinite(fps) and 1 <= fps <= 1000 else 25.0
    return np.arange(len(times)) / rate, [f"times of frames do not ascend: {rate:.5g} frames a second are assumed"]


def _frames(
    file: Path, header: VideoHeader, numbers: list[int], size: tuple[int, int]
) -> Iterator[UInt8[np.ndarray, "h w 3"]]:
    """Decode the chosen frames."""
    width, height = size
    with _decoding(file, header, frames=numbers, size=size) as (_, stream):
        for number in numbers:
            content = stream.read(3 * width * height)
            if len(content) < 3 * width * height:
                raise InputError("cannot be decoded a second time", file=file, field=f"frame {number}")
            yield np.frombuffer(content, np.uint8).reshape(height, width, 3)


@contextmanager
def _decoding(
    file: Path, header: VideoHeader, frames: list[int] | None, size: tuple[int, int] | None
) -> Iterator[tuple[_Answer, IO[bytes]]]:
    """Run the decoder, and end it with the block."""
    request = {"frames": frames, "quarter_turns": header.quarter_turns, "size": size, "max_pixels": MAX_FRAME_PIXELS}
    process = subprocess.Popen(
        # An absolute path names a file, whatever protocols its name resembles.
        [sys.executable, "-P", decoder.__file__, str(file.resolve())],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=os.environ | decoder.ENVIRONMENT,
    )
    try:
        assert process.stdin and process.stdout
        process.stdin.write(json.dumps(request).encode())
        process.stdin.close()
        content = process.stdout.read(decoder.ANSWER.size)
        if len(content) < decoder.ANSWER.size:
            raise _failure(process.wait(), file)
        yield _Answer(*decoder.ANSWER.unpack(content)), process.stdout
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


def _failure(code: int, file: Path) -> InputError:
    """What the end of a decoder that sent nothing means."""
    if code == decoder.TOO_LARGE:
        return InputError(f"the header claims frames of more than {MAX_FRAME_PIXELS} pixels", file=file)
    if code == decoder.CANNOT_OPEN:
        return InputError("the decoder cannot open it: damaged, or no pictures", file=file)
    return InputError(f"the decoder ended with code {code}: damaged, or it needs too much memory", file=file)
