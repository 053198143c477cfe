"""Settings of the data: the capture and the true caricature."""

from __future__ import annotations

from dataclasses import dataclass, field

from carigs.settings.option import MAX_COUNT, MAX_SEED, Section, option


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
    """Number of cameras on a frontal cap; of six or more, the most frontal one is the validation view."""
    steps_per_sequence: int = option(3, ge=1, le=1000)
    """Frames in each of the ten sequences EMO-1..4 and EXP-1..6."""
    supersampling: int = option(3, ge=1, le=16)
    """Samples per pixel along each axis."""
    texture_size: int = option(768, unit="texels", ge=128, le=8192)
    """Square root of the number of texels of the skin."""
    hair: str = option("short", choices=("short", "long"))
    """Hair of the scalp: `short` (the style of the seed), or `long`: a fringe over the forehead, hair over ears and
    nape."""
    hair_strands: int = option(6000, ge=1, le=1_000_000)
    """Number of hair strands on the scalp."""
    shirt: bool = False
    """A striped shirt: collar and shoulders below the neck, which do not turn with the head."""


@dataclass
class CaptureSettings(Section, key="capture"):
    """The subject to reconstruct: the procedural toy, a folder in the layout of GaussianAvatars, or a video."""

    source: str = option("toy", choices=("toy", "folder", "video"))
    """Where the capture comes from."""
    video: str | None = option(None, required_when=("source", ("video",)), is_path=True)
    """A video of one person; a folder of photographs of one moment; or a folder that holds one video, or one folder of
    frames, for each of several cameras. The section `track` says how it is read."""
    folder: str | None = option(None, required_when=("source", ("folder",)), is_path=True)
    """The dataset's folder."""
    head_model: str | None = option(None, required_when=("source", ("folder", "video")), is_path=True)
    """File of the dataset's head model, or of the one that is fitted to a video: .npz, or FLAME's .pkl."""
    background: float = option(1.0, ge=0, le=1)
    """Grey value that the images were composited on; those of a video are put on it."""
    split: str = "files"
    """Which frames are held out: `files` (as transforms_{train,val,test}.json say), `released` (the test sequence of
    GaussianAvatars' released data, by the subject's number), `blocks` (5 of every 20 timesteps), or the name of the
    test sequence, for example `EXP-2`."""
    validation_camera: int | None = option(None, ge=0, le=MAX_COUNT)
    """Camera of the validation frames. Null: as the files say; where `split` is not `files`, camera 8, or the last. Of
    fewer than six cameras, all are for training, and some timesteps for validation."""
    stride: int = option(1, ge=1, le=MAX_COUNT)
    """Every n-th timestep of each sequence is used."""
    max_frames: int | None = option(None, ge=1, le=MAX_COUNT)
    """Largest number of frames of each split; timesteps are left out evenly. Null: all."""
    cy: str = option("auto", choices=("auto", "opencv", "flipped"))
    """Whether `cy` counts from the top of the image (opencv) or from its bottom (flipped, as VHAP has it since November
    2024). auto compares outlines of the posed mesh and of mattes, unless the principal point is in the middle."""
    body: str = option("keep", choices=("keep", "cut"))
    """What happens to neck, shoulders and clothes below the head model, of a folder or a video. `keep`: where frames
    show them, surfels of their own do, which move with the border of the neck. `cut`: frames and mattes end below the
    chin, which makes a bust."""
    match_exposure: bool = True
    """Match exposure and white balance of training frames to those of the validation camera, or of the most frontal
    one, where they differ. Frames that are held out stay as they are; so do those of the toy."""
    mend_outlines: bool = True
    """Make mattes that do not fit the images anew near their outline, and remove the colour of an old background from
    the outline of training frames. Only images that were composited on the stated background tell; frames of the toy
    stay as they are."""
    toy: Toy = field(default_factory=Toy)


@dataclass
class Truth(Section, key="truth"):
    """The true caricature that renderings are compared with: rendered for the toy, else read from a folder."""

    folder: str | None = option(None, is_path=True)
    """Folder with `frames.json`, `images/` and `fg_masks/`; `{level}` in it is replaced by the level. Null: no true
    caricature is known, except for the toy."""
