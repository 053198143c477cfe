"""Which images there are: the index of rendered frames and the index of true images."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from carigs.capture.dataset import read_json
from carigs.errors import InputError


@dataclass(frozen=True)
class Rendered:
    """One rendered frame."""

    protocol: str
    """`test` (held-out sequence), `val` (novel view) or `orbit` (novel camera trajectory)."""
    timestep: int
    camera: int
    """Of the capture; on the orbit its frame number."""
    order: int
    """Position among the rendered frames."""
    file: Path


@dataclass(frozen=True)
class Truths:
    """True images of one level by (timestep, camera), or the reason why there are none."""

    reason: str | None
    images: dict[tuple[int, int], Path]
    masks: dict[tuple[int, int], Path]


def read_rendered(index: Path, folder: Path | None = None) -> list[Rendered]:
    """Frames of `frames.json`, by protocol and order; raises `InputError` for a broken entry or a missing image.

    Images are looked for in `folder`, else in `frames/` next to the index, else next to it.
    """
    entries = read_json(index)
    if not isinstance(entries, list):
        raise InputError("expected a list of frames", file=index)
    frames = []
    for i, entry in enumerate(entries):
        name = _take(entry, "file", str, index, f"[{i}]")
        file = folder / name if folder is not None else _beside(index, name)
        if not file.is_file():
            raise InputError(f"no such image: {file}", file=index, field=f"[{i}].file")
        numbers = {key: _take(entry, key, int, index, f"[{i}]") for key in ("timestep", "camera", "order")}
        frames.append(Rendered(protocol=_take(entry, "protocol", str, index, f"[{i}]"), file=file, **numbers))
    return sorted(frames, key=lambda frame: (frame.protocol, frame.order))


def read_truths(index: Path) -> Truths:
    """The true images of `truth.json` (beside it, or in `frames/` next to it).

    Raises `InputError` for a broken entry or a missing image.
    """
    content = read_json(index)
    if not isinstance(content, dict) or not isinstance(content.get("frames"), list):
        raise InputError("expected an object with a list of frames", file=index, field="frames")
    images, masks = {}, {}
    for i, entry in enumerate(content["frames"]):
        key = tuple(_take(entry, name, int, index, f"frames[{i}]") for name in ("timestep", "camera"))
        for name, files in (("image", images), ("mask", masks)):
            files[key] = _beside(index, _take(entry, name, str, index, f"frames[{i}]"))
            if not files[key].is_file():
                raise InputError(f"no such image: {files[key]}", file=index, field=f"frames[{i}].{name}")
    return Truths(reason=content.get("reason"), images=images, masks=masks)


def _beside(index: Path, name: str) -> Path:
    """`name` in the folder `frames` next to the index, or right next to it."""
    file = index.parent / "frames" / name
    return file if file.is_file() else index.parent / name


def _take(entry: object, key: str, kind: type, file: Path, field: str):
    value = entry.get(key) if isinstance(entry, dict) else None
    if not isinstance(value, kind) or isinstance(value, bool):
        raise InputError(f"expected {'a whole number' if kind is int else 'a text'}", file=file, field=f"{field}.{key}")
    return value
