"""Settings of the data: the capture and the true caricature."""

from __future__ import annotations

from dataclasses import dataclass, field

from carigs.settings.option import MAX_SEED, Section, option


@dataclass
class Toy(Section, key="capture.toy"):
    """The procedural subject, used when `capture.source` is `toy`."""

    seed: int = option(1, ge=0, le=MAX_SEED)
    """Seed of the person: identity, skin and hair."""
    width: int = option(208, unit="pixels", ge=16, le=8192)
    """Width of the images."""
    height: int = option(272, unit="pixels", ge=16, le=8192)
    """Height of the images."""
    cameras: int = option(9, ge=1, le=1000)
    """Number of cameras on a frontal cap; the most frontal one is the validation view."""
    steps_per_sequence: int = option(3, ge=1, le=1000)
    """Frames in each of the ten sequences EMO-1..4 and EXP-1..6."""
    supersampling: int = option(3, ge=1, le=16)
    """Samples per pixel along each axis."""
    texture_size: int = option(768, unit="texels", ge=128, le=8192)
    """Square root of the number of texels of the skin."""
    hair_strands: int = option(6000, ge=1, le=1_000_000)
    """Number of hair strands on the scalp."""


@dataclass
class Capture(Section, key="capture"):
    """The subject to reconstruct: the procedural toy, or a folder in the layout of GaussianAvatars."""

    source: str = option("toy", choices=("toy", "folder"))
    """Where the capture comes from."""
    folder: str | None = option(None, required_when=("source", "folder"))
    """The dataset's folder."""
    head_model: str | None = option(None, required_when=("source", "folder"))
    """File of the dataset's head model: .npz, or FLAME's .pkl."""
    background: float = option(1.0, ge=0, le=1)
    """Grey value that the images were composited on."""
    toy: Toy = field(default_factory=Toy)


@dataclass
class Truth(Section, key="truth"):
    """The true caricature that renderings are compared with: rendered for the toy, else read from a folder."""

    folder: str | None = None
    """Folder with `frames.json`, `images/` and `fg_masks/`; `{level}` in it is replaced by the level. Null: no true
    caricature is known, except for the toy."""
