"""What advice, tables and the contact sheet need to know of tracked frames."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float, Int, UInt8

from carigs.detection.mesh_indices import REGIONS
from carigs.head import HeadModel, neutral, pose
from carigs.tracking.dataset import tracked_cameras
from carigs.tracking.footage_tracking import FootageTrack
from carigs.tracking.judgement.contact_sheet import Overlay, contact_sheet, frames_to_show
from carigs.tracking.judgement.quality import TrackedFrames, face_sharpness, head_angles, openings
from carigs.tracking.recording import Recording

View = tuple[int, int]
"""A recording, and the position of one of its frames."""


class JudgedFrames:
    """The tracked head in the images, for one sequence of views after the other.

    Args:
        track: The tracked head.
        recordings: The frames.
        numbers: Which of the detector's landmarks the tracker uses.
    """

    def __init__(self, track: FootageTrack, recordings: Sequence[Recording], numbers: Int[np.ndarray, " n"]) -> None:
        self._track, self._recordings, self._numbers = track, recordings, numbers
        model, parameters = track.head.model, track.head.parameters
        self._cameras = tracked_cameras(track, recordings)
        self._vertices = [pose(model, values) for values in parameters]
        self._skull = _skull(model, neutral(model, parameters[0]))
        self._timestep = {int(k): t for t, k in enumerate(track.kept)}
        self._camera = {int(r): c for c, r in enumerate(track.cameras)}

    def sequences(self) -> dict[str, list[View]]:
        """The views that are judged together: those of each camera; of one moment, all.

        Returns:
            Views by the name of the file or folder.
        """
        recordings = self._recordings
        if self._track.one_moment:
            first, last = recordings[0].footage.source, recordings[-1].footage.source
            return {(first if first == last else first.parent).name: [(r, 0) for r in range(len(recordings))]}
        names = [recording.name for recording in recordings]
        unique = [name if names.count(name) == 1 else f"{name} ({r})" for r, name in enumerate(names)]
        return {name: [(r, k) for k in range(len(recordings[r].footage))] for r, name in enumerate(unique)}

    def judged(self, views: Sequence[View]) -> TrackedFrames:
        """Put together what is known of views.

        Args:
            views: A sequence.

        Returns:
            Values of all of them.
        """
        track, head = self._track, self._track.head
        reasons = tuple(track.left_out[r][k] for r, k in views)
        tracked = [i for i, reason in enumerate(reasons) if not reason]
        places = [(self._timestep[views[i][1]], self._camera[views[i][0]]) for i in tracked]

        def filled(values: Sequence[float] | np.ndarray) -> Float[np.ndarray, " n"]:
            found = np.full(len(views), np.nan)
            found[tracked] = values
            return found

        rest = head.model.v_template[self._skull]
        turns = np.array([
            self._cameras[c].camera_from_world[:3, :3] @ _axes(self._vertices[t][self._skull], rest) for t, c in places
        ]).reshape(-1, 3, 3)  # fmt: skip
        middles = np.array([self._cameras[c].to_camera(self._vertices[t][self._skull]).mean(axis=0) for t, c in places])
        yaw, pitch = head_angles(turns, middles.reshape(-1, 3))
        errors = {
            name: filled([_mean(head.errors[t, c, np.isin(self._numbers, members)]) for t, c in places])
            for name, members in REGIONS.items()
            if np.isin(self._numbers, members).any()
        }
        found = [(self._recordings[views[i][0]], views[i][1]) for i in tracked]
        boxes = np.array([recording.faces.boxes[k] for recording, k in found]).reshape(-1, 4)
        mouth, eyes = openings(np.array([recording.faces.landmarks[k] for recording, k in found], np.float64))
        sharpness = {view: face_sharpness(image, tuple(self._box(view))) for view, image in self._images(views)}
        return TrackedFrames(
            np.array([self._recordings[r].footage.numbers[k] for r, k in views]),
            np.array([self._recordings[r].footage.times[k] for r, k in views]),
            reasons,
            filled(yaw),
            filled(pitch),
            errors,
            filled(boxes[:, 2] - boxes[:, 0]),
            filled([self._outside(t, c) for t, c in places]),
            filled(mouth),
            filled(eyes),
            filled([sharpness[views[i]] for i in tracked]),
            np.array([self._recordings[r].measures.exposure[k] for r, k in views]),
        )

    def sheet(self, name: str, views: Sequence[View], frames: TrackedFrames) -> UInt8[np.ndarray, "h w 3"]:
        """Draw worst and typical views with the mesh and the landmarks.

        Args:
            name: Title.
            views: A sequence.
            frames: What is known of it.

        Returns:
            sRGB.
        """
        worst, typical = frames_to_show(frames)
        chosen = [views[i] for i in sorted({*worst, *typical})]
        overlays = {}
        for (r, k), image in self._images(chosen):
            t, c = self._timestep[k], self._camera[r]
            pixels, _ = self._cameras[c].project(self._vertices[t])
            landmarks = self._track.landmarks[t, c].copy()
            landmarks[np.isnan(self._track.head.errors[t, c])] = np.nan
            overlays[views.index((r, k))] = Overlay(image, pixels, landmarks, self._track.head.projected[t, c])
        return contact_sheet(frames, overlays, self._track.head.model.faces, name)

    def _images(self, views: Sequence[View]) -> Iterator[tuple[View, UInt8[np.ndarray, "h w 3"]]]:
        """Images of views, recording after recording."""
        wanted = {*views}
        for r in sorted({r for r, _ in views}):
            for k, image in enumerate(self._recordings[r].footage.decode()):
                if (r, k) in wanted:
                    yield (r, k), image

    def _box(self, view: View) -> Float[np.ndarray, "4"]:
        return np.nan_to_num(self._recordings[view[0]].faces.boxes[view[1]])

    def _outside(self, t: int, c: int) -> float:
        """Share of the skull outside the image."""
        camera = self._cameras[c]
        pixels, _ = camera.project(self._vertices[t][self._skull])
        inside = (pixels >= 0).all(axis=1) & (pixels[:, 0] < camera.width) & (pixels[:, 1] < camera.height)
        return 1 - float(inside.mean())


def _mean(errors: Float[np.ndarray, " n"]) -> float:
    """Of the landmarks that count; NaN without any."""
    known = errors[np.isfinite(errors)]
    return float(known.mean()) if len(known) else np.nan


def _skull(model: HeadModel, rest: Float[np.ndarray, "v 3"]) -> Int[np.ndarray, " k"]:
    return np.flatnonzero(rest[:, 1] > np.median(model.v_template[:, 1]))


def _axes(posed: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Rotation of the skull (Kabsch 1976)."""
    u, _, vt = np.linalg.svd((posed - posed.mean(axis=0)).T @ (rest - rest.mean(axis=0)))
    return u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
