"""Stage `truth`: what the test frames would look like if the person were their caricature.  Never shown to training."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

from rich.progress import track

from carigs.capture import Capture
from carigs.capture.dataset import read_json
from carigs.capture.images import png_size, write_png
from carigs.errors import InputError
from carigs.exaggeration import Caricature, GammaPath
from carigs.files import writing, writing_folder
from carigs.settings import Truth


def truth(settings: Truth, *, capture: Path, path: Path, level: float, frames: Path, index: Path) -> None:
    """Write the true images of this level into `frames`, and their list into `index`, or the reason why there are none.

    Level 0 is the capture itself (test and validation frames); other levels are rendered for the toy, or come from
    `settings.folder`, or are unknown, as for every real person.
    """
    subject = Capture.load(capture)
    reason = None
    with writing_folder(frames) as part:
        if level == 0:
            entries = _captured(subject, part)
        elif (subject.root / "subject.npz").is_file():
            entries = _rendered(subject, GammaPath.load(path).at(level), part)
        elif settings.folder and (folder := Path(settings.folder.replace("{level}", f"{level:g}"))).is_dir():
            entries = _given(subject, folder, part)
        else:
            entries, reason = [], f"no true caricature of this subject at level {level:g}"
    with writing(index) as part_index:
        part_index.write_text(json.dumps({"level": level, "reason": reason, "frames": entries}, indent=1))


def _entry(timestep: int, camera: int) -> dict[str, object]:
    name = f"{timestep:05d}_{camera:02d}"
    return {"timestep": timestep, "camera": camera, "image": f"{name}.png", "mask": f"{name}_mask.png"}


def _captured(subject: Capture, folder: Path) -> list[dict[str, object]]:
    entries = []
    for frame in (*subject.split("test"), *subject.split("val")):
        entries.append(_entry(frame.timestep, frame.camera))
        shutil.copyfile(subject.root / frame.image, folder / f"{frame.name}.png")
        shutil.copyfile(subject.root / frame.mask, folder / f"{frame.name}_mask.png")
    return entries


def _rendered(subject: Capture, caricature: Caricature, folder: Path) -> list[dict[str, object]]:
    from carigs.toy import load_subject, render_subject

    person = load_subject(subject.root)
    entries = []
    for frame in track(subject.split("test"), description="truth", disable=len(subject.split("test")) < 10):
        colour, alpha = render_subject(
            person, subject.parameters(frame.timestep), subject.cameras[frame.camera], caricature
        )
        entries.append(_entry(frame.timestep, frame.camera))
        write_png(folder / f"{frame.name}.png", colour)
        write_png(folder / f"{frame.name}_mask.png", alpha)
    return entries


def _given(subject: Capture, source: Path, folder: Path) -> list[dict[str, object]]:
    listing = source / "frames.json"
    given = read_json(listing)
    if not isinstance(given, list):
        raise InputError("expected a list of frames", file=listing)
    entries = []
    for i, item in enumerate(given):
        for key in ("timestep_index", "camera_index", "file_path", "fg_mask_path"):
            if not isinstance(item, dict) or key not in item:
                raise InputError("this key is missing", file=listing, field=f"[{i}].{key}")
        camera = subject.cameras.get(item["camera_index"])
        if camera is None:
            raise InputError(
                f"the capture has no camera {item['camera_index']}", file=listing, field=f"[{i}].camera_index"
            )
        entry = _entry(item["timestep_index"], item["camera_index"])
        for key, name in (("file_path", "image"), ("fg_mask_path", "mask")):
            if png_size(source / item[key]) != (camera.width, camera.height):
                raise InputError(f"its camera has {camera.width} x {camera.height} pixels", file=source / item[key])
            shutil.copyfile(source / item[key], folder / str(entry[name]))
        entries.append(entry)
    return entries
