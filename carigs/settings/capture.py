"""Settings of the data: the capture and the true caricature."""

from __future__ import annotations

from dataclasses import dataclass, field

from carigs.settings.option import Section, option


@dataclass
class Toy(Section, key="capture.toy"):
    """The procedural subject, used when `capture.source` is `toy`."""

    seed: int = option(1, "Seed of the person: identity, skin and hair.", ge=0)
    width: int = option(208, "Width of the images.", "pixels", ge=16)
    height: int = option(272, "Height of the images.", "pixels", ge=16)
    cameras: int = option(9, "Number of cameras on a frontal cap; the most frontal one is the validation view.", ge=1)
    steps_per_sequence: int = option(3, "Frames in each of the ten sequences EMO-1..4 and EXP-1..6.", ge=1)
    supersampling: int = option(3, "Samples per pixel along each axis.", ge=1)
    texture_size: int = option(768, "Square root of the number of texels of the skin.", "texels", ge=128)
    hair_strands: int = option(6000, "Number of hair strands on the scalp.", ge=1)


@dataclass
class Capture(Section, key="capture"):
    """The subject to reconstruct: the procedural toy, or a folder in the layout of GaussianAvatars."""

    source: str = option("toy", "Where the capture comes from.", choices=("toy", "folder"))
    folder: str | None = option(None, "The dataset's folder.", required_when=("source", "folder"))
    head_model: str | None = option(
        None, "File of the dataset's head model: .npz, or FLAME's .pkl.", required_when=("source", "folder")
    )
    background: float = option(1.0, "Grey value that the images were composited on.", ge=0, le=1)
    toy: Toy = field(default_factory=Toy)


@dataclass
class Truth(Section, key="truth"):
    """The true caricature that renderings are compared with: rendered for the toy, else read from a folder."""

    folder: str | None = option(
        None,
        "Folder with `frames.json`, `images/` and `fg_masks/`; `{level}` in it is replaced by the level."
        " Null: no true caricature is known, except for the toy.",
    )
