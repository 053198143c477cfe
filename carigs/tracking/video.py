"""Footage of one person becomes a dataset: landmarks, solver, mattes, and what is to be said about the recording."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np
from jaxtyping import Float32, Int
from threadpoolctl import threadpool_limits

from carigs.capture.dataset_writer import check_target
from carigs.capture.images import write_png
from carigs.detection import FaceNetworks, collect, follow_face, load_face_networks
from carigs.detection.mesh_indices import COUNT
from carigs.detection.person import PersonSegmenter, load_person_segmenter
from carigs.errors import InputError
from carigs.fitting.landmarks.embedding import read_embedding
from carigs.footage import Selection, TimedFrame
from carigs.footage.measures import measure_frames
from carigs.footage.photographs import each_photograph
from carigs.footage.stored import stored
from carigs.head import HeadModel
from carigs.matting import MattedFrame, matted_frames
from carigs.matting.computed_ahead import computed_ahead
from carigs.matting.one_person import of_one_person
from carigs.settings import Track
from carigs.tracking.dataset import write_tracked_dataset
from carigs.tracking.footage_tracking import FootageTrack, choose_frames, track_footage
from carigs.tracking.held_out import SPLITS
from carigs.tracking.judgement.advice import advice, advice_of_cameras
from carigs.tracking.judgement.error_table import error_table
from carigs.tracking.judgement.held_out_gap import tracked_pose_gap
from carigs.tracking.judgement.judged_frames import JudgedFrames
from carigs.tracking.kinds import AUTO, ORBIT, PHOTOGRAPHS, TALK, why_orbit, why_photographs
from carigs.tracking.recording import Recording, oddities
from carigs.tracking.sources import (
    camera_sources,
    frames_in_step,
    scaled_focal_length,
    set_photographs_upright,
    set_upright,
)

SHEET, TABLE = "tracking.png", "tracking.txt"
"""Files of the dataset that say how well the head was tracked."""
MOST_VIEWS = 96
"""Views of an orbit that are used."""

Progress = Callable[[Iterable, str, int], Iterable]
"""Shows how far an iteration is: iterable, name, number of items."""


@dataclass(frozen=True)
class VideoReport:
    """What is to be said of tracked footage."""

    kind: str
    """What it is, and why, if that was found out."""
    focal_lengths: tuple[float, ...]
    """Pixels, of each lens."""
    focal_guesses: tuple[float, ...]
    frames: int
    """Images of all cameras."""
    tracked: int
    """Those in which the face was found."""
    errors: str
    """Table of the errors by region."""
    held_out: str
    """How far the head poses of test frames lie from those of training frames."""
    advice: tuple[str, ...]


def track_video(
    settings: Track,
    folder: Path,
    *,
    sources: Sequence[Path] | None = None,
    weights: Path | None = None,
    progress: Progress = lambda items, name, count: items,
    status: Callable[[str], AbstractContextManager] = nullcontext,
) -> VideoReport:
    """Track the head of a person before cameras that were not calibrated, and write a dataset.

    Args:
        settings: The footage, the head model, and how they are read.
        folder: Dataset to create.
        sources: The recordings of the cameras, in place of those that the settings name.
        weights: Folder of weights that is searched first.
        progress: Wraps iterations over frames.
        status: Makes a context that shows what is done in it.

    Returns:
        What is to be said. The dataset holds the same as a picture and a table.

    Raises:
        CarigsError: If a package or the weights are not there, the folder is not empty, or the footage cannot be used.
    """
    check_target(folder)
    networks, segmenter = load_face_networks(weights), load_person_segmenter(weights)
    sources = sources or camera_sources(Path(settings.video or ""))
    model = HeadModel.load(settings.head_model)
    points, numbers = read_embedding(settings.embedding and Path(settings.embedding), model, COUNT)
    # One thread of BLAS: the same bytes with any number of cores, and mattes have threads of their own.
    with _folder_beside(folder) as decoded, threadpool_limits(1, "blas"):
        kind, recordings = read_recordings(settings, sources, networks, progress, decoded)
        lengths = _given_focal_lengths(recordings, settings.focal_length)
        chosen = choose_frames(recordings)
        each = chain.from_iterable(person_mattes(recordings[r], chosen.kept, segmenter) for r in chosen.cameras)
        pixels = max(r.footage.width * r.footage.height for r in recordings)
        with computed_ahead(each, pixels) as matted:  # while the solver runs on one thread
            with status("fitting the head"):
                track = track_footage(recordings, chosen, model, points, numbers, focal_lengths=lengths)
            track = write_tracked_dataset(
                folder,
                track,
                recordings,
                progress(matted, "mattes", chosen.faces.size),
                background=settings.background,
                landmarks=points,
                numbers=numbers,
                by_time=SPLITS[settings.held_out],
            )
        gap = str(tracked_pose_gap(track, recordings, SPLITS[settings.held_out]))
        return _report(kind, track, recordings, JudgedFrames(track, recordings, numbers), gap, folder)


@contextmanager
def _folder_beside(folder: Path) -> Iterator[Path]:
    """A folder for decoded frames, on the disk that has room for the dataset; it is removed with its contents."""
    scratch = folder.parent / f".{folder.name}.decoded"
    shutil.rmtree(scratch, ignore_errors=True)
    scratch.mkdir(parents=True)
    try:
        yield scratch
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def person_mattes(
    recording: Recording, kept: Int[np.ndarray, " t"], segmenter: PersonSegmenter
) -> Iterator[MattedFrame]:
    """Make the mattes of the person whose face is tracked.

    Args:
        recording: What a camera recorded.
        kept: Positions of the frames that are tracked.
        segmenter: Finds people.

    Returns:
        These frames with their mattes, in order.
    """
    clip = recording.footage.at(kept)
    boxes = dict(zip(clip.numbers, recording.faces.boxes[kept], strict=True))

    def coarse(frame: TimedFrame) -> Float32[np.ndarray, "s s"]:
        matte = segmenter(frame.image)
        scale = np.tile(np.divide(matte.shape[::-1], (clip.width, clip.height)), 2)
        return of_one_person(matte, boxes[frame.number] * scale)

    return matted_frames(clip, coarse)


def _given_focal_lengths(recordings: Sequence[Recording], focal: float | None) -> list[float | None]:
    """The focal length of the settings in pixels of each recording, if there is one."""
    scaled = {r.footage.source: focal and scaled_focal_length(r.footage, focal) for r in recordings}
    return [scaled[recording.footage.source] for recording in recordings]


def _report(
    kind: str, track: FootageTrack, recordings: Sequence[Recording], judge: JudgedFrames, gap: str, folder: Path
) -> VideoReport:
    """Judge a track, and write what is to be said of it into the dataset."""
    views = judge.sequences()
    frames = {name: judge.judged(seen) for name, seen in views.items()}
    write_png(folder / SHEET, np.vstack([judge.sheet(name, views[name], frames[name]) for name in views]) / 255.0)
    if len(frames) == 1:
        [(_, seen)] = frames.items()
        table, lines = error_table(seen), advice(seen, moving_camera=track.one_moment)
    else:
        table = "\n\n".join(f"{name}\n{error_table(seen)}" for name, seen in frames.items())
        lines = advice_of_cameras(frames)
    lines = [*oddities(recordings), *lines]
    (folder / TABLE).write_text("\n".join([table, gap, *lines, ""]), "utf-8")
    count, shown = sum(len(r.footage) for r in recordings), sum(int(seen.tracked.sum()) for seen in frames.values())
    cameras = track.head.cameras
    first = [int(np.flatnonzero(cameras.lens == lens)[0]) for lens in range(cameras.lens_count)]
    lengths, guesses = (tuple(map(float, values[first])) for values in (cameras.focal, track.focal_guesses))
    return VideoReport(kind, lengths, guesses, count, shown, table, gap, tuple(lines))


def read_recordings(
    settings: Track, sources: Sequence[Path], networks: FaceNetworks, progress: Progress, decoded: Path
) -> tuple[str, list[Recording]]:
    """Read footage, and find the face in it.

    Args:
        settings: How it is read.
        sources: A file or folder of each camera.
        networks: That find landmarks.
        progress: As of `track_video`.
        decoded: Folder for decoded frames; it must stay as long as the recordings are used.

    Returns:
        What kind of footage it is, in words; and as many frames of each camera, of one moment one for each view.

    Raises:
        InputError: If the footage cannot be read, or is not of the kind that the settings name.
    """
    told, source = settings.footage, sources[0]
    if len(sources) > 1 and told not in (AUTO, TALK):
        remedy = "one recording is expected; several are those of cameras that stand still"
        raise InputError(f"track.footage={told}, and {len(sources)} recordings", file=source, remedy=remedy)
    why = told == AUTO and len(sources) == 1 and source.is_dir() and why_photographs(source)
    if told == PHOTOGRAPHS or why:
        if not source.is_dir():
            raise InputError("is no folder of photographs", file=source)
        images = each_photograph(source, Selection(largest_side=settings.largest_side))
        upright = set_photographs_upright(images, networks)
        footages = [stored(image, image.decode(), decoded / f"{i}") for i, image in enumerate(upright)]
        # Each on its own: the next one may show the face elsewhere.
        one_by_one = (result for footage in footages for result in follow_face(footage.decode(), networks))
        found = progress(one_by_one, "landmarks", len(footages))
        faces = [collect([result]) for result in found]
        recordings = [Recording(f, face, measure_frames(f)) for f, face in zip(footages, faces, strict=True)]
        return f"photographs of one moment{f': {why}' if why else ''}", recordings
    footages = frames_in_step(sources, settings.frame_rate, settings.largest_side)
    recordings = []
    for i, clip in enumerate(set_upright(footage, networks) for footage in footages):
        clip = stored(clip, progress(clip.decode(), "frames", len(clip)), decoded / f"{i}")
        faces = collect(progress(follow_face(clip.decode(), networks), "landmarks", len(clip)))
        recordings.append(Recording(clip, faces, measure_frames(clip)))
    why = told == AUTO and len(sources) == 1 and why_orbit(recordings[0])
    if told == ORBIT or why:
        return f"a camera that circles a person{f': {why}' if why else ''}", recordings[0].views(MOST_VIEWS)
    names = ", ".join(recording.name for recording in recordings)
    stands = (
        "one camera that stands still" if len(sources) == 1 else f"{len(sources)} cameras that stand still: {names}"
    )
    return stands, recordings
