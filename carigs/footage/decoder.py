"""Decode a video in a process of its own, which can do nothing else: `python -P decoder.py FILE < request`.

FFmpeg, inside OpenCV, has hundreds of parsers, and the file comes from a stranger. This process opens one file, by the
protocol `file` alone, with the containers and codecs of `ENVIRONMENT`; it has limits of memory and time, and writes no
files. If the decoder crashes, the parent reads the end of a stream. It imports nothing of carigs, so that it starts at
once.

The request is a JSON object: `frames`, the numbers of frames to send, ascending, or null to list the times of all;
`quarter_turns`, `size` (of the upright frames, or null), `max_pixels`. Frames are read in order: seeking is not exact
in every container. The answer is binary: `ANSWER`, then one float64 (seconds) or one RGB image for each frame.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import struct
import sys

ANSWER = struct.Struct("<IIddI")
"""Width and height of the upright frames in pixels, frames per second, number of frames that the header claims, bits
of a channel."""
MEMORY, SECONDS_PER_FRAME = 3 << 30, 60
"""Limits, in bytes of address space and seconds."""
DEMUXERS = "mov,matroska,avi,gif"
CODECS = (
    "h264,hevc,av1,libdav1d,libaom-av1,vp8,vp9,libvpx,libvpx-vp9,"
    "mpeg4,mpeg2video,h263,mjpeg,prores,gif,png,ffv1,huffyuv"
)
ENVIRONMENT = {
    "OPENCV_FFMPEG_CAPTURE_OPTIONS": (
        f"protocol_whitelist;file|format_whitelist;{DEMUXERS}|codec_whitelist;{CODECS}|enable_drefs;0"
    ),
    "OPENCV_LOG_LEVEL": "SILENT",
    "OPENCV_FFMPEG_LOGLEVEL": "-8",
}
"""Of the process: options of FFmpeg that OpenCV takes from nowhere else."""
CANNOT_OPEN, TOO_LARGE = 3, 4
"""Exit codes."""


def main() -> int:
    """Answer one request.

    Returns:
        Exit code.
    """
    limit_process()
    import cv2  # after the limits

    request, out = json.load(sys.stdin), sys.stdout.buffer
    cv2.setNumThreads(1)
    video = cv2.VideoCapture(sys.argv[1], cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, 2])
    # Frames are turned here: whether OpenCV does depends on its version, and its size on whether it does.
    if not video.isOpened() or not video.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0):
        return CANNOT_OPEN
    width, height = (int(video.get(p)) for p in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
    if width * height > request["max_pixels"]:
        return TOO_LARGE
    if request["quarter_turns"] % 2:
        width, height = height, width
    claims = video.get(cv2.CAP_PROP_FPS), video.get(cv2.CAP_PROP_FRAME_COUNT)
    pixel_format = int(video.get(cv2.CAP_PROP_CODEC_PIXEL_FORMAT)).to_bytes(4, "little", signed=False)
    out.write(ANSWER.pack(width, height, *claims, pixel_format[3] if pixel_format[:2] == b"Y3" else 8))
    _send_times(video, out) if request["frames"] is None else _send_frames(video, out, request)
    out.flush()
    return 0


def limit_process() -> None:
    """Take from this process what decoding does not need, where the system can."""
    with contextlib.suppress(ImportError, ValueError, OSError):  # Windows; a lower limit; macOS
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))


def _grab(video) -> bool:
    """Decode the next frame; a decoder that does not come to an end is killed."""
    if hasattr(signal, "alarm"):
        signal.alarm(SECONDS_PER_FRAME)
    found = video.grab()
    if hasattr(signal, "alarm"):
        signal.alarm(0)
    return found


def _send_times(video, out) -> None:
    """Send the time of each frame that can be decoded."""
    import cv2

    while _grab(video):
        out.write(struct.pack("<d", video.get(cv2.CAP_PROP_POS_MSEC) / 1000))


def _send_frames(video, out, request) -> None:
    """Send the frames that were asked for, upright and scaled."""
    import cv2

    turns = (None, cv2.ROTATE_90_CLOCKWISE, cv2.ROTATE_180, cv2.ROTATE_90_COUNTERCLOCKWISE)[request["quarter_turns"]]
    number = -1
    for wanted in request["frames"]:
        while number < wanted:
            if not _grab(video):
                return
            number += 1
        found, image = video.retrieve()
        if not found:
            return
        if turns is not None:
            image = cv2.rotate(image, turns)
        if image.shape[1::-1] != (size := tuple(request["size"])):
            image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        out.write(cv2.cvtColor(image, cv2.COLOR_BGR2RGB).data)


if __name__ == "__main__":
    os.environ.update(ENVIRONMENT)
    sys.exit(main())
