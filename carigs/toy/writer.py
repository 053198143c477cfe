"""Writing a capture of the procedural subject to disk, in the folder layout of GaussianAvatars."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track

from carigs.capture.camera import OPENCV_FROM_OPENGL, Camera
from carigs.capture.images import write_png
from carigs.head import HeadParameters, flame_joints
from carigs.settings import Toy
from carigs.system.files import writing
from carigs.toy.renderer import pose_subject
from carigs.toy.scene import Timestep, split_names, studio_cameras, timesteps
from carigs.toy.subject import make_subject


def write_capture(folder: Path, settings: Toy) -> None:
    """Render and write a capture: images, masks, head parameters, splits, `head_model.npz` and `subject.npz`.

    The images are what `render_subject` gives for the parameters on disk.

    Args:
        folder: Where the capture is written; created if it does not exist.
        settings: The subject, the size of the images, the number of cameras and timesteps.
    """
    folder = Path(folder)
    for name in ("images", "fg_masks", "flame_param"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    subject, cameras = make_subject(settings), studio_cameras(settings)
    with writing(folder / "head_model.npz") as part:
        subject.model.save(part)
    subject.save(folder / "subject.npz")
    timeline = timesteps(settings, subject.shape)
    parameters = []
    for t, step in enumerate(timeline):
        step.parameters.save(folder / _parameter_file(t), subject.model)
        parameters.append(HeadParameters.load(folder / _parameter_file(t), subject.model))
    open_mouth = HeadParameters(shape=subject.shape, joints=flame_joints(jaw=[0.3, 0.0, 0.0]))
    open_mouth.save(folder / "canonical_flame_param.npz", subject.model)

    def render_timestep(t: int) -> None:
        posed = pose_subject(subject, parameters[t])
        for c, camera in enumerate(cameras):
            colour, alpha = posed.render(camera)
            write_png(folder / _image_file(t, c), colour)
            write_png(folder / _mask_file(t, c), alpha)

    _run_with_progress(render_timestep, len(timeline))
    _write_splits(folder, timeline, cameras)


def _image_file(t: int, c: int) -> str:
    return f"images/{t:05d}_{c:02d}.png"


def _mask_file(t: int, c: int) -> str:
    return f"fg_masks/{t:05d}_{c:02d}.png"


def _parameter_file(t: int) -> str:
    return f"flame_param/{t:05d}.npz"


def _run_with_progress(render_timestep: Callable[[int], None], count: int) -> None:
    render_timestep(0)  # compiles the kernels once, before two threads need them
    console = Console(stderr=True)
    quiet = count < 5 or not sys.stderr.isatty()
    with ThreadPoolExecutor(2) as pool:
        done = pool.map(render_timestep, range(1, count))
        for _ in track(done, "rendering the toy", count - 1, console=console, transient=True, disable=quiet):
            pass


def _write_splits(folder: Path, timeline: tuple[Timestep, ...], cameras: tuple[Camera, ...]) -> None:
    """Write the splits."""
    splits: dict[str, list[tuple[int, int]]] = {"train": [], "val": [], "test": []}
    for t, names in enumerate(split_names([step.sequence for step in timeline], cameras)):
        for c, split in enumerate(names):
            splits[split].append((t, c))
    shared = ("cx", "cy", "fl_x", "fl_y", "h", "w", "camera_angle_x", "camera_angle_y")
    for split, views in splits.items():
        frames = [_frame_entry(t, c, timeline[t], cameras[c]) for t, c in views]
        content: dict[str, object] = {key: frames[-1][key] for key in shared if frames}
        content["timestep_indices"] = sorted({t for t, _ in views})
        content["camera_indices"] = sorted({c for _, c in views})
        content["frames"] = frames
        with writing(folder / f"transforms_{split}.json") as part:
            part.write_text(json.dumps(content, indent=1))


def _frame_entry(t: int, c: int, step: Timestep, camera: Camera) -> dict[str, object]:
    return {
        "timestep_index": t,
        "timestep_index_original": step.index,
        "timestep_id": f"{step.index:05d}",
        "sequence": step.sequence,
        "camera_index": c,
        "camera_id": f"{c:02d}",
        "cx": camera.cx,
        "cy": camera.cy,
        "fl_x": camera.fx,
        "fl_y": camera.fy,
        "h": camera.height,
        "w": camera.width,
        "camera_angle_x": float(2 * np.arctan(camera.width / (2 * camera.fx))),
        "camera_angle_y": float(2 * np.arctan(camera.height / (2 * camera.fy))),
        "transform_matrix": (camera.world_from_camera @ OPENCV_FROM_OPENGL).tolist(),
        "file_path": _image_file(t, c),
        "fg_mask_path": _mask_file(t, c),
        "flame_param_path": _parameter_file(t),
    }
