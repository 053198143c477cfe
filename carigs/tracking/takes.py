"""Which frames of recordings are tracked: those of one person in one shot, with cuts and interruptions between them.

A cut, or a face that is suddenly elsewhere or another one, ends a take. Takes belong together if what is beside the
head is the same in both, and the face is: after a hand before the face, or when the head comes back into the image. The
camera has not moved then, and one head and one focal length are true for all. Before a plain wall, a camera that zooms
in is not told from a person who comes nearer; for the tracker they are nearly the same.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from carigs.capture.evenly_spread import evenly_spread
from carigs.detection.face_track import listed
from carigs.detection.likeness import SAME, differences
from carigs.errors import InputError
from carigs.footage import Footage
from carigs.footage.cuts import find_cuts
from carigs.footage.measures import THUMBNAIL, correlation
from carigs.tracking.recording import Recording

LEAST_FRAMES = 10
"""That show a face, in one shot."""
LEAST_PRESENCE, LEAST_INSIDE = 0.5, 0.5
"""Probability of the face, and share of its landmarks in the image, below which a frame is left out."""
OTHER_SHOT = 0.02
"""Change of what is beside the head at a cut: 1 - correlation of medians over time. Two takes of a real person before
one camera differ by 0.003, and a textured wall that is shifted by 2 % of the image by 0.05."""
BESIDE, ABOVE = (0.5, 0.25, 0.1), 0.5
"""What is at least so far to the left or the right of all boxes of the face, or above them, in its width, is beside the
head; below the chin are shoulders. Of the first, the largest that leaves enough of the image counts."""
LEAST_BESIDE = 0.02
"""Share of the image that is enough; otherwise the whole image is compared."""
COMPARED = 16
"""Frames of a take that are compared with those of another one."""


def kept_frames(recordings: Sequence[Recording]) -> tuple[Int[np.ndarray, " t"], tuple[tuple[str, ...], ...]]:
    """Find the frames of the longest shot of one person.

    Args:
        recordings: As many frames of each camera.

    Returns:
        Their positions, and why the others of each recording are left out.

    Raises:
        InputError: If there are too few.
    """
    count = len(recordings[0].faces.found)
    good = np.array([shows_face(recording) for recording in recordings])
    seen = good.any(axis=0)
    shot = _shots(recordings, np.searchsorted(_cuts(recordings), np.arange(count), side="right"), good)
    longest = np.bincount(shot[seen], minlength=1).argmax() if seen.any() else 0
    kept = np.flatnonzero(seen & (shot == longest))
    beyond = np.array([recording.faces.found for recording in recordings]) & ~good
    missing = np.where(beyond, "less than half of the face in the image", "no face")
    reasons = np.where(~good, missing, np.where(shot != longest, "another shot, or another face", ""))
    if 1 < count and len(kept) < LEAST_FRAMES:
        problem = f"{len(kept)} of {count} frames show one face in one shot; at least {LEAST_FRAMES} are needed"
        raise InputError(f"{problem} ({_why(recordings[0], reasons[0])})", file=recordings[0].footage.source)
    return (np.array([0]) if count == 1 else kept), tuple(map(tuple, reasons.tolist()))


def _why(recording: Recording, reasons: Shaped[np.ndarray, " t"]) -> str:
    """The reasons for which frames of a recording are left out, with their numbers in it."""
    numbers = np.array(recording.footage.numbers)
    return "; ".join(f"{reason}: {listed(reasons == reason, numbers)}" for reason in sorted({*reasons} - {""}))


def shows_face(recording: Recording) -> Bool[np.ndarray, " t"]:
    """Find the frames of a recording that show the face, or most of it.

    Args:
        recording: What one camera recorded.

    Returns:
        Whether each does.
    """
    inside = in_image(recording.faces.landmarks[..., :2], recording.footage)
    return (recording.faces.presence >= LEAST_PRESENCE) & (inside.mean(axis=1) >= LEAST_INSIDE)


def in_image(pixels: Float[np.ndarray, "*s 2"], footage: Footage) -> Bool[np.ndarray, "*s"]:
    """Find the landmarks that the camera sees: a network places the others where they might be.

    Args:
        pixels: Landmarks; NaN for missing ones.
        footage: The frames.

    Returns:
        Whether each lies in the image.
    """
    return ((pixels >= 0) & (pixels <= (footage.width, footage.height))).all(axis=-1)


def _cuts(recordings: Sequence[Recording]) -> Int[np.ndarray, " k"]:
    """Where a take begins: most cameras cut, or see the face jump."""
    count = len(recordings[0].faces.found)
    cut = np.zeros((len(recordings), count), bool)
    for row, recording in zip(cut, recordings, strict=True):
        row[find_cuts(recording.measures)] = True
        row |= recording.faces.jumped
    return np.flatnonzero(cut.mean(axis=0) > 0.5)


def _shots(
    recordings: Sequence[Recording], take: Int[np.ndarray, " t"], good: Bool[np.ndarray, "c t"]
) -> Int[np.ndarray, " t"]:
    """Number of the shot of each frame, from that of its take: takes that show the same are one shot."""
    members = [np.flatnonzero(take == number) for number in range(take.max(initial=-1) + 1)]
    pairs = [
        (a, b)
        for b in range(len(members))
        for a in range(b)
        if _same(recordings, [frames[good[:, frames].any(axis=0)] for frames in (members[a], members[b])], good)
    ]
    rows, columns = np.array(pairs, int).reshape(-1, 2).T
    links = coo_array((np.ones(len(pairs)), (rows, columns)), shape=(len(members), len(members)))
    return connected_components(links, directed=False)[1][take]


def _same(recordings: Sequence[Recording], takes: list[Int[np.ndarray, " m"]], good: Bool[np.ndarray, "c t"]) -> bool:
    """Whether two takes show the same person and place, to most of the cameras that see the face in both."""
    votes = []
    for recording, shows in zip(recordings, good, strict=True):
        first, second = (evenly_spread(frames[shows[frames]].tolist(), COMPARED) for frames in takes)
        if first and second:
            colours = recording.faces.colours
            alike = differences(colours[first], colours[second]).min() <= SAME
            votes.append(alike and _change_beside(recording, first, second) < OTHER_SHOT)
    return sum(votes) > 0.5 * len(votes)


def _change_beside(recording: Recording, first: list[int], second: list[int]) -> float:
    """How the median image of some frames differs from that of others, beside the head."""
    footage, images = recording.footage, recording.measures.thumbnails
    scale = np.array([THUMBNAIL / footage.width, THUMBNAIL / footage.height])
    beside = _beside(recording.faces.boxes[[*first, *second]].reshape(-1, 2, 2) * scale)
    medians = [np.median(images[frames], axis=0)[beside] for frames in (first, second)]
    return 1 - correlation(*medians)


def _beside(boxes: Float[np.ndarray, "m 2 2"]) -> Bool[np.ndarray, "s s"]:
    """Pixels of a thumbnail that are beside all heads and above all chins, or all if these are too few."""
    (left, top), right, chin = boxes[:, 0].min(axis=0), boxes[:, 1, 0].max(), boxes[:, 1, 1].min()
    width = (boxes[:, 1, 0] - boxes[:, 0, 0]).max()
    centres = np.arange(THUMBNAIL) + 0.5
    for share in BESIDE:
        apart = (centres < left - share * width) | (centres > right + share * width)
        beside = (centres < top - ABOVE * width)[:, None] | (apart[None] & (centres < chin)[:, None])
        if beside.mean() > LEAST_BESIDE:
            return beside
    return np.ones_like(beside)
