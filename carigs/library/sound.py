"""Sound of clips, which ffmpeg adds: OpenCV writes pictures alone."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

from carigs.errors import InputError, PackageMissing
from carigs.readers.limits import regular_file_size
from carigs.system.files import writing

SOUNDS = (".wav", ".mp3", ".m4a", ".ogg", ".opus", ".flac")
CODECS = {".mp4": "libopus", ".webm": "libopus"}
TIMEOUT = 600
"""Most seconds that ffmpeg may take."""


def check_sound(sound: Path, clip: Path) -> None:
    """Check before anything is rendered whether a clip can get a sound.

    Args:
        sound: The sound.
        clip: The clip.

    Raises:
        InputError: If the clip is no video, or the sound is missing or of another format.
        PackageMissing: If there is no ffmpeg.
    """
    if clip.suffix not in CODECS:
        raise InputError(f"only {' and '.join(CODECS)} clips and pages have sound", file=clip)
    if sound.suffix.lower() not in SOUNDS:
        raise InputError(f"a sound is one of {', '.join(SOUNDS)}", file=sound)
    regular_file_size(sound, "sound")
    if shutil.which("ffmpeg") is None:
        raise PackageMissing(
            f"--audio: the program ffmpeg puts sound into {clip.suffix} files; install it, or write .html"
        )


def add_sound(clip: Path, sound: Path) -> None:
    """Put a sound into a video, which keeps its pictures; the shorter of both ends it.

    Args:
        clip: The video, which is replaced.
        sound: The sound.

    Raises:
        InputError: If ffmpeg fails.
    """
    with writing(clip) as part:
        command = ["ffmpeg", "-v", "error", "-nostdin", "-y", "-i", str(clip.resolve()), "-i", str(sound.resolve())]
        command += ["-map", "0:v:0", "-map", "1:a:0", "-c:v", "copy", "-c:a", CODECS[clip.suffix], "-shortest"]
        command += ["-f", clip.suffix[1:], str(part.resolve())]
        ended = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT)
        if ended.returncode:
            raise InputError(f"ffmpeg cannot read it ({ended.stderr.strip().splitlines()[-1:]})", file=sound)
