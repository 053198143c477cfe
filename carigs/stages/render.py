"""Stage `render`: images of the trained avatar at one level, for every protocol, and metrics of its geometry."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.progress import track

from carigs.capture import Camera, Capture, Frame
from carigs.capture.capture_json import camera_to_json
from carigs.capture.frame_index import write_frame_index
from carigs.capture.images import write_png
from carigs.capture.orbit import orbit_cameras
from carigs.errors import SettingsError
from carigs.files import writing_folder
from carigs.head import read_subject_path
from carigs.lap_times import timed
from carigs.settings import Render
from evaluation.card.costs import FRAME
from evaluation.tables.frame_records import FrameRecord, write_frame_records


class View(NamedTuple):
    """One image to render."""

    protocol: str
    """`test`: held-out sequence; `val`: held-out view, level 0 only; `orbit`: novel cameras, fixed expression."""
    timestep: int
    camera: int
    """Camera of the capture; for the orbit, the number of the frame."""
    sequence: str

    @property
    def file(self) -> str:
        """Name of the image below the folder of frames."""
        return f"{self.protocol}/{self.timestep:05d}_{self.camera:02d}.png"


def render(
    settings: Render,
    *,
    avatar: Path,
    capture: Path,
    path: Path,
    level: float,
    frames: Path,
    index: Path,
    geometry: Path,
) -> None:
    """Render the avatar for the protocols test, val and orbit.

    Args:
        settings: Settings of the stage.
        avatar: Input: the trained avatar.
        capture: Input: the index of the capture.
        path: Input: the exaggeration path, which replaces the avatar's copy.
        level: Exaggeration level.
        frames: Output: folder of PNG images.
        index: Output: protocol, timestep, camera and file of each image, in rendering order.
        geometry: Output: CSV of metrics that need the avatar's depth, normals, opacity and surfels.

    Raises:
        SettingsError: If the level lies outside the path.
    """
    from carigs.simd.threads import use_threads

    use_threads(settings.threads)
    from carigs.splat.avatar import load_avatar
    from evaluation.metrics.avatar_geometry import AvatarGeometry

    subject, person = Capture.load(capture), load_avatar(avatar)
    gamma_path = read_subject_path(path, person.sequence.head)
    if not 0 <= level <= gamma_path.gamma_f:
        raise SettingsError(f"level {level:g} lies outside the path's [0, {gamma_path.gamma_f:g}]")
    person.sequence.path = gamma_path
    views, entries = list(rendered_views(settings, subject, level)), []
    meter, measured = AvatarGeometry(subject, person, gamma_path, level, settings.backend), list[FrameRecord]()
    with writing_folder(frames) as part:
        for view, camera in track(views, description=f"render level {level:g}", disable=len(views) < 10):
            with timed(FRAME):
                shown = person.render_frame(view.timestep, level, camera, backend=settings.backend)
            file = view.file
            (part / file).parent.mkdir(exist_ok=True)
            write_png(part / file, shown.image.numpy())
            novel = {"view": camera_to_json(camera)} if view.protocol == "orbit" else {}
            entries.append({**view._asdict(), "file": file, **novel})
            if view.protocol == "test":  # tables show no others
                measured += meter.records(view.timestep, view.camera, camera, shown.world)
    write_frame_index(index, entries)
    write_frame_records(geometry, measured)


def rendered_views(settings: Render, subject: Capture, level: float) -> Iterator[tuple[View, Camera]]:
    """List what is rendered of an avatar at a level, for every protocol.

    Args:
        settings: Settings of the stage.
        subject: The capture.
        level: Exaggeration level.

    Yields:
        Views with their cameras, in rendering order.

    Raises:
        SettingsError: The capture has no timestep for the orbit.
    """
    frames = {
        "test": spread_test_frames(subject, settings.test_timesteps),
        "val": subject.split("val") if level == 0 else (),
    }
    for split, shown in frames.items():
        for frame in shown:
            yield View(split, frame.timestep, frame.camera, frame.sequence), subject.camera(frame)
    if settings.orbit_frames:
        frame = _orbit_frame(settings, subject)
        for i, camera in enumerate(orbit_cameras(subject, settings.orbit_frames, settings.orbit_degrees)):
            yield View("orbit", frame.timestep, i, frame.sequence), camera


def spread_test_frames(subject: Capture, timesteps: int | None) -> tuple[Frame, ...]:
    """Choose the test frames that are rendered: of all cameras, at timesteps that are spread evenly.

    Args:
        subject: The capture.
        timesteps: Number of timesteps; None for all.

    Returns:
        The frames, in their order.
    """
    frames = subject.split("test")
    known = sorted({frame.timestep for frame in frames})
    if timesteps is None or timesteps >= len(known):
        return frames
    chosen = {known[i] for i in np.linspace(0, len(known) - 1, timesteps).round().astype(int)}
    return tuple(frame for frame in frames if frame.timestep in chosen)


def _orbit_frame(settings: Render, subject: Capture) -> Frame:
    for frame in (*subject.split("test"), *subject.frames):
        if settings.orbit_timestep in (None, frame.timestep):
            return frame
    raise SettingsError(f"render.orbit_timestep={settings.orbit_timestep} is not a timestep of the capture")
