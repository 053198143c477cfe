"""Stage `render`: images of the trained avatar at one level, for every protocol."""

from __future__ import annotations

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.progress import track

from carigs.capture import Camera, Capture, Frame, look_at
from carigs.capture.images import write_png
from carigs.errors import SettingsError
from carigs.exaggeration import GammaPath
from carigs.files import writing, writing_folder
from carigs.settings import Render


class View(NamedTuple):
    """One image to render."""

    protocol: str
    """`test`: held-out sequence; `val`: novel view, level 0 only; `orbit`: novel cameras, fixed expression."""
    timestep: int
    camera: int
    """Of the capture; on the orbit its frame number."""
    sequence: str


def render(
    settings: Render, *, avatar: Path, capture: Path, path: Path, level: float, frames: Path, index: Path
) -> None:
    """Write PNGs into the folder `frames`, and `index`: what each of them shows, in a stated order."""
    from carigs.simd.threads import use_threads

    use_threads(settings.threads)
    from carigs.splat.avatar import load_avatar

    subject, gamma_path, person = Capture.load(capture), GammaPath.load(path), load_avatar(avatar)
    if not 0 <= level <= gamma_path.gamma_f:
        raise SettingsError(f"level {level:g} lies outside the path's [0, {gamma_path.gamma_f:g}]")
    person.sequence.path = gamma_path
    views, cameras = _views(settings, subject, level)
    entries = []
    with writing_folder(frames) as part:
        for view in track(views, description=f"render level {level:g}", disable=len(views) < 10):
            image = person.render(view.timestep, level, cameras[view.protocol, view.camera], backend=settings.backend)
            file = f"{view.protocol}/{view.timestep:05d}_{view.camera:02d}.png"
            (part / file).parent.mkdir(exist_ok=True)
            write_png(part / file, image)
            entries.append({**view._asdict(), "file": file, "order": len(entries)})
    with writing(index) as part_index:
        part_index.write_text(json.dumps(entries, indent=1))


def _views(settings: Render, subject: Capture, level: float) -> tuple[list[View], dict[tuple[str, int], Camera]]:
    splits = ("test", "val") if level == 0 else ("test",)
    views = [View(s, frame.timestep, frame.camera, frame.sequence) for s in splits for frame in subject.split(s)]
    cameras = {(split, c): camera for split in splits for c, camera in subject.cameras.items()}
    if settings.orbit_frames:
        frame = _orbit_frame(settings, subject)
        for i, camera in enumerate(orbit_cameras(subject, settings.orbit_frames, settings.orbit_degrees)):
            views.append(View("orbit", frame.timestep, i, frame.sequence))
            cameras["orbit", i] = camera
    return views, cameras


def _orbit_frame(settings: Render, subject: Capture) -> Frame:
    if settings.orbit_timestep is None:
        return (*subject.split("test"), *subject.frames)[0]
    for frame in subject.frames:
        if frame.timestep == settings.orbit_timestep:
            return frame
    raise SettingsError(f"render.orbit_timestep={settings.orbit_timestep} is no timestep of the capture")


def orbit_cameras(subject: Capture, count: int, degrees: float) -> list[Camera]:
    """Cameras on an arc of `degrees` about the vertical axis through the point that the training cameras look at.

    Height, distance and intrinsics are the training cameras' means, the arc's middle their mean azimuth.
    """
    used = sorted({frame.camera for frame in subject.split("train")}) or sorted(subject.cameras)
    cameras = [subject.cameras[c] for c in used]
    target = nearest_point(cameras)
    offsets = np.array([camera.centre for camera in cameras]) - target
    radius = np.linalg.norm(offsets[:, [0, 2]], axis=1).mean()
    direction = (offsets[:, [0, 2]] / np.linalg.norm(offsets[:, [0, 2]], axis=1, keepdims=True)).mean(axis=0)
    azimuths = np.arctan2(*direction) + np.radians(degrees) * np.linspace(-0.5, 0.5, count)
    width, height = round(np.mean([c.width for c in cameras])), round(np.mean([c.height for c in cameras]))
    fx, fy, cx, cy = np.mean([[c.fx, c.fy, c.cx, c.cy] for c in cameras], axis=0).tolist()
    centres = target + np.stack(
        [radius * np.sin(azimuths), np.full(count, offsets[:, 1].mean()), radius * np.cos(azimuths)], axis=1
    )
    return [Camera(look_at(centre, target), fx, fy, cx, cy, width, height) for centre in centres]


def nearest_point(cameras: list[Camera]) -> np.ndarray:
    """The point nearest to all optical axes (least squares); the mean of the axes 1 m ahead if they are parallel."""
    axes = np.array([camera.camera_from_world[2, :3] for camera in cameras])
    centres = np.array([camera.centre for camera in cameras])
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    matrix = across.sum(axis=0)
    if np.linalg.cond(matrix) > 1e6:
        return (centres + axes).mean(axis=0)
    return np.linalg.solve(matrix, np.einsum("nij,nj->i", across, centres))
