"""Stage `render`: images of the trained avatar at every level and for every protocol, and metrics of its geometry."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from rich.progress import track

from carigs.capture import Camera, Capture, Frame
from carigs.capture.capture_json import camera_to_json
from carigs.capture.evenly_spread import evenly_spread
from carigs.capture.frame_index import level_folder, write_frame_index
from carigs.capture.images import write_png
from carigs.capture.orbit import orbit_cameras
from carigs.errors import SettingsError
from carigs.exaggeration import GammaPath
from carigs.head import read_subject_path
from carigs.runs.lap_times import timed
from carigs.settings import Render
from carigs.system.files import resuming_folder
from evaluation.card.costs import frame_step
from evaluation.tables.frame_records import FrameRecord, write_frame_records

if TYPE_CHECKING:
    from carigs.splat.avatar import Avatar

ORBIT_DEGREES = 60.0
"""Range of azimuth of the orbit."""


class ViewToRender(NamedTuple):
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
    frames: Path,
    resume_key: str,
    threads: int = 1,
) -> None:
    """Render the avatar for the protocols test, val and orbit.

    One job renders all levels, because the libraries, the kernels and the avatar take longer to load than a small scene
    to render. If the job is killed, the next one goes on with the levels that are missing.

    Args:
        settings: Settings of the stage.
        avatar: Input: the trained avatar.
        capture: Input: the index of the capture.
        path: Input: the exaggeration path, which replaces the avatar's copy, unless nothing moves on that.
        frames: Output: for each level a folder (`level_folder`) of PNG images below `test/`, `val/` and `orbit/`, with
            frames.json, their protocols, timesteps and cameras in rendering order, and geometry.csv, the metrics that
            need the avatar's depth, normals, opacity and surfels.
        resume_key: Digest of all that the output depends on; levels that a run with another one has left are not used.
        threads: Threads of the rasterizer; the result does not depend on it.

    Raises:
        SettingsError: If a level lies outside the path.
    """
    from carigs.simd.threads import use_threads

    use_threads(threads)
    from carigs.splat.avatar import load_avatar

    subject, person = Capture.load(capture), load_avatar(avatar)
    head = person.sequence.head
    gamma_path = read_subject_path(path, head, head.v_template)
    for level in settings.levels:
        if not 0 <= level <= gamma_path.gamma_f:
            raise SettingsError(f"level {level:g} lies outside the path's [0, {gamma_path.gamma_f:g}]")
    if person.sequence.path.is_still:  # edited images on a mesh that is not exaggerated
        gamma_path = gamma_path.still()
    person.sequence.path = gamma_path
    with resuming_folder(frames, resume_key) as (part, _):
        for level in settings.levels:
            _render_level(settings, subject, person, gamma_path, level, level_folder(part, level))


def _render_level(
    settings: Render, subject: Capture, person: Avatar, path: GammaPath, level: float, folder: Path
) -> None:
    """Render one level, unless its index, which is written last, is there."""
    from evaluation.metrics.avatar_geometry import AvatarGeometry

    if (folder / "frames.json").is_file():
        return
    views, entries = list(rendered_views(settings, subject, level)), []
    meter, measured = AvatarGeometry(subject, person, path, level, settings.backend), list[FrameRecord]()
    for view, camera in track(views, description=f"render level {level:g}", disable=len(views) < 10):
        with timed(frame_step(level)):
            shown = person.render_frame(view.timestep, level, camera, backend=settings.backend)
        file = view.file
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        write_png(folder / file, shown.image.numpy())
        novel = {"view": camera_to_json(camera)} if view.protocol == "orbit" else {}
        still = {"mesh_level": 0.0} if path.is_still else {}
        entries.append({**view._asdict(), "file": file, **novel, **still})
        if view.protocol == "test":  # tables show no others
            measured += meter.records(view.timestep, view.camera, camera, shown.world)
    write_frame_records(folder / "geometry.csv", measured)
    write_frame_index(folder / "frames.json", entries)


def rendered_views(settings: Render, subject: Capture, level: float) -> Iterator[tuple[ViewToRender, Camera]]:
    """List what is rendered of an avatar at a level, for every protocol.

    Args:
        settings: Settings of the stage.
        subject: The capture.
        level: Exaggeration level.

    Yields:
        Views with their cameras, in rendering order.
    """
    frames = {
        "test": spread_test_frames(subject.split("test"), settings.test_timesteps),
        "val": subject.split("val") if level == 0 else (),
    }
    for split, shown in frames.items():
        for frame in shown:
            yield ViewToRender(split, frame.timestep, frame.camera, frame.sequence), subject.camera(frame)
    if settings.orbit_frames:
        frame = next(iter((*subject.split("test"), *subject.frames)))
        for i, camera in enumerate(orbit_cameras(subject, settings.orbit_frames, ORBIT_DEGREES)):
            yield ViewToRender("orbit", frame.timestep, i, frame.sequence), camera


def spread_test_frames(frames: tuple[Frame, ...], timesteps: int | None) -> tuple[Frame, ...]:
    """Choose the test frames that are rendered: of all cameras, at timesteps that are spread evenly.

    Args:
        frames: All test frames.
        timesteps: Number of timesteps; None for all.

    Returns:
        The frames, in their order.
    """
    known = sorted({frame.timestep for frame in frames})
    if timesteps is None or timesteps >= len(known):
        return frames
    chosen = evenly_spread(known, timesteps)
    return tuple(frame for frame in frames if frame.timestep in chosen)
