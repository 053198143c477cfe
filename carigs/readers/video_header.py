"""What stands in the header of a video, read before a decoder sees the file.

A decoder follows what a file says: playlists (HLS, FFmpeg's concat) name other files and addresses. A file is therefore
recognised by its first bytes, whatever its name is, and only containers that hold their own pictures are accepted.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

from carigs.errors import InputError
from carigs.readers.limits import regular_file_size

START_BYTES = 1 << 12
MATROSKA_HEADER_BYTES = 1 << 20
"""Where the description of the tracks is searched for; recorders write it first."""
MAX_INDEX_BYTES = 64 << 20
"""Of an MP4's index (`moov`), which grows with the number of frames: an hour has about 2 MB."""
MAX_BOXES = 10_000

_ISO_BOXES = (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip", b"pnot", b"styp")
_EBML, _TRANSFER, _CLUSTER = b"\x1a\x45\xdf\xa3", b"\x55\xba\x81", b"\x1f\x43\xb6\x75"
"""Matroska: the file's start, the element TransferCharacteristics of one byte, the start of the first pictures."""
_HDR = {16: "PQ", 18: "HLG"}
"""Transfer characteristics of ITU-T H.273; every other one is standard dynamic range."""
_TURNS = {(1, 0, 0, 1): 0, (0, 1, -1, 0): 1, (-1, 0, 0, -1): 2, (0, -1, 1, 0): 3}
"""Quarter turns clockwise, by the first four entries of a track's matrix."""
_PLAYLISTS = (b"#EXTM3U", b"ffconcat", b"[playlist]", b"<?xml", b"<MPD", b"<smil", b"<asx", b"v=0", b"rtsptext")


class VideoHeader(NamedTuple):
    """What the header of a video says."""

    container: str
    """`mp4` (also MOV), `matroska` (also WebM), `avi` or `gif`."""
    quarter_turns: int = 0
    """By which pictures are turned clockwise to stand upright: phones store all of them in the sensor's orientation."""
    hdr: str | None = None
    """`HLG` or `PQ` for high dynamic range, else None."""


def read_video_header(file: str | Path) -> VideoHeader:
    """Recognise a video by its content, and read how its pictures are to be shown.

    Args:
        file: The video.

    Returns:
        The header.

    Raises:
        InputError: If the file is missing, no regular file, no video of a known container, or a playlist; or if an MP4
            has no index or no pictures.
    """
    size = regular_file_size(file, "video")
    try:
        with Path(file).open("rb") as stream:
            start = stream.read(START_BYTES)
            if start[4:8] in _ISO_BOXES:
                return _iso_header(stream, size, file)
            if start.startswith(_EBML):
                content = (start + stream.read(MATROSKA_HEADER_BYTES)).split(_CLUSTER)[0]
                _, found, value = content.partition(_TRANSFER)
                return VideoHeader("matroska", hdr=_HDR.get(value[0]) if found and value else None)
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", file=file) from error
    if start.startswith(b"RIFF") and start[8:12] == b"AVI ":
        return VideoHeader("avi")
    if start.startswith((b"GIF87a", b"GIF89a")):
        return VideoHeader("gif")
    if start.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(_PLAYLISTS):
        raise InputError("a playlist, which names other files; give the video itself", file=file)
    raise InputError("not a video that carigs reads: MP4, MOV, MKV, WebM, AVI or GIF", file=file)


def _iso_header(stream: BinaryIO, size: int, file: str | Path) -> VideoHeader:
    """Of an MP4 or MOV (ISO/IEC 14496-12): the matrix of its video track (`tkhd`) and its colours (`colr`)."""
    index = _movie_index(stream, size)
    if index is None:
        remedy = "repair it with the program that recorded it"
        raise InputError("the index (moov) is missing: the recording was cut off", file=file, remedy=remedy)
    tracks = [index[first:last] for kind, first, last in _boxes(index) if kind == b"trak"]
    videos = [track for track in tracks if b"hdlr" in track and track[track.index(b"hdlr") + 12 :][:4] == b"vide"]
    if not videos:
        raise InputError("no pictures: the file holds sound alone" if tracks else "no pictures", file=file)
    track = videos[0]
    colours = track.partition(b"colrnclx")[2][:6]
    transfer = int.from_bytes(colours[2:4], "big") if len(colours) == 6 else 0
    return VideoHeader("mp4", _quarter_turns(track), _HDR.get(transfer))


def _movie_index(stream: BinaryIO, size: int) -> bytes | None:
    """Content of the box `moov`; None if the file has none, or less of it than it says."""
    position = 0
    for _ in range(MAX_BOXES):
        stream.seek(position)
        head = stream.read(16)
        if len(head) < 8:
            return None
        length, header = int.from_bytes(head[:4], "big"), 8
        if length == 1:  # the size follows the name
            length, header = int.from_bytes(head[8:16], "big"), 16
        length = length or size - position  # 0: up to the end of the file
        if length < header:
            return None
        if head[4:8] == b"moov":
            if length > MAX_INDEX_BYTES or position + length > size:
                return None
            stream.seek(position + header)
            return stream.read(length - header)
        position += length
    return None


def _boxes(content: bytes) -> Iterator[tuple[bytes, int, int]]:
    """Kind, start and end of the boxes in the content of a box; a broken length ends them."""
    position = 0
    while position + 8 <= len(content):
        length = int.from_bytes(content[position : position + 4], "big")
        if length < 8:
            return
        yield content[position + 4 : position + 8], position + 8, position + length
        position += length


def _quarter_turns(track: bytes) -> int:
    """Of the pictures of a track; 0 if its matrix is no rotation by right angles."""
    for kind, first, last in _boxes(track):
        if kind == b"tkhd":
            start = first + (52 if track[first : first + 1] == b"\1" else 40)  # version 1 has times of 64 bits
            if start + 20 > min(last, len(track)):
                return 0
            a, b, _, c, d = struct.unpack(">5i", track[start : start + 20])
            return _TURNS.get(tuple(value / 65536 for value in (a, b, c, d)), 0)
    return 0
