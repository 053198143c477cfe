"""The page of an avatar: one HTML file that asks for nothing from any network.

The text of the page is escaped by the template. A policy in the page (Content Security Policy, W3C) allows its script
and style sheet by their digests, its worker, and images in the page alone.
"""

from __future__ import annotations

import base64
import io
import json
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from hashlib import sha256
from pathlib import Path

import numpy as np
from jinja2 import Environment, StrictUndefined
from PIL import Image

from carigs.errors import CarigsError, CarigsWarning, InputError, SettingsError
from carigs.exaggeration import GammaPath
from carigs.head import HeadModel
from carigs.library.driving import driven_parameters
from carigs.library.head_avatar import HeadAvatar
from carigs.library.orbit_cameras import orbit
from carigs.motion import BUILT_IN, Motion
from carigs.readers.limits import read_bytes
from carigs.system.files import writing
from carigs.viewer.html.drive_arrays import PageClip, drive_arrays
from carigs.viewer.html.head_arrays import head_arrays
from carigs.viewer.html.light_arrays import light_arrays
from carigs.viewer.html.packed_arrays import deflated
from carigs.viewer.html.surfel_arrays import surfel_arrays

CLIP_LENGTH = 30
"""Most timesteps of the clip unless it is given."""
REGIONS = ("nose", "lips", "left_ear", "right_ear", "forehead", "eye_region")
"""Regions with a slider unless they are given, where the head has them."""
FIRST_SHARE = 0.5
"""Level that is shown first, as a share of the highest."""
POSTER_SIZE = 512
SOUNDS = {".wav": "audio/wav", ".mp3": "audio/mpeg", ".ogg": "audio/ogg", ".m4a": "audio/mp4"}
MAX_SOUND = 64 << 20
"""Bytes."""
MAX_CLIP_FRAMES = 20_000
WORKER = ("data", "head", "hair", "solids", "rig", "surfels", "worker")
SCRIPT = ("renderer", "camera", "controls", "viewer")
"""Scripts `page.*.js` of the worker and of the page, in their order."""
SHADERS = {
    "surfelVert": "surfel.vert", "surfelFrag": "surfel.frag", "imageVert": "image.vert", "imageFrag": "image.frag",
}  # fmt: skip


def write_html(
    avatar: HeadAvatar,
    file: str | Path,
    *,
    timesteps: Sequence[int] | None = None,
    regions: Sequence[str] | None = None,
    level: float | None = None,
    title: str | None = None,
    fps: float = 24.0,
    motions: Mapping[str, Motion] | None = None,
    sounds: Mapping[str, str | Path] | None = None,
    driver: HeadModel | None = None,
) -> None:
    """Write an avatar as one HTML file, which needs neither a server nor a network.

    The page renders the surfels as `HeadAvatar.render` does, but for numbers that are rounded to make the file small.

    Args:
        avatar: The avatar.
        file: File to write (.html).
        timesteps: Timesteps of the clip, of `avatar.timesteps`; None for the first `CLIP_LENGTH`.
        regions: Names of regions that get a slider, of `avatar.regions`; None for those of `REGIONS` that there are.
        level: Exaggeration that is shown first; None for `FIRST_SHARE` of the highest.
        title: Title of the page; None for the name of the file.
        fps: Timesteps per second when the clip of the capture is played.
        motions: Motions that the page plays, by the names that it shows; None for those of `carigs.motion.BUILT_IN`, if
            the head has expressions that they know.
        sounds: Sound files (.wav, .mp3, .ogg, .m4a) of motions by their names.
        driver: Head model that the motions belong to, if their expressions have no names that this head knows.

    Raises:
        InputError: If a sound cannot be read.
        SettingsError: If a timestep or a region is not the avatar's, a number is out of range, or a motion cannot be
            transferred.

    Example:
        >>> import carigs
        >>> avatar = carigs.load("avatar.npz")  # doctest: +SKIP
        >>> carigs.write_html(avatar, "avatar.html", regions=["nose", "lips"])  # doctest: +SKIP
    """
    clip = checked_clip(avatar, timesteps)
    first_level = FIRST_SHARE * avatar.gamma if level is None else level
    if not (0 < fps <= 1000 and abs(first_level) <= 100):
        raise SettingsError(f"fps={fps:g}, level={first_level:g}: expected numbers, fps from 0 to 1000")
    clips = _clips(avatar, motions, {name: Path(sound) for name, sound in (sounds or {}).items()}, driver)
    text = _page(avatar, clip, _region_paths(avatar, regions), clips, title or Path(file).stem, first_level, fps)
    with writing(file) as part:
        part.write_text(text, encoding="utf-8")


def checked_clip(avatar: HeadAvatar, timesteps: Sequence[int] | None) -> list[int]:
    """Check the timesteps of a clip.

    Args:
        avatar: The avatar.
        timesteps: Timesteps; None for the first `CLIP_LENGTH` of the avatar.

    Returns:
        The timesteps.

    Raises:
        SettingsError: If there is none, or one that the avatar does not have.
    """
    known = avatar.timesteps
    clip = known[:CLIP_LENGTH] if timesteps is None else list(timesteps)
    unknown = [t for t in clip if t not in known]
    if unknown or not clip:
        what = f"timestep {unknown[0]}" if unknown else "no timestep"
        raise SettingsError(f"clip: {what}; the avatar has {known[0]} to {known[-1]} ({len(known)})")
    return clip


def _region_paths(avatar: HeadAvatar, regions: Sequence[str] | None) -> dict[str, GammaPath]:
    if regions is not None:
        return {name: avatar.region_path(name) for name in regions}
    paths = {}
    for name in (name for name in REGIONS if name in avatar.regions):
        with suppress(SettingsError):  # a region that cannot be exaggerated alone has no slider
            paths[name] = avatar.region_path(name)
    return paths


def _clips(
    avatar: HeadAvatar, motions: Mapping[str, Motion] | None, sounds: Mapping[str, Path], driver: HeadModel | None
) -> list[PageClip]:
    sequence, chosen = avatar.avatar.sequence, motions is not None
    motions = {name: make() for name, make in BUILT_IN.items()} if motions is None else motions
    if unknown := [name for name in sounds if name not in motions]:
        raise SettingsError(f"sounds: there is no motion {unknown[0]}")
    clips = []
    for name, motion in motions.items():
        if len(motion) > MAX_CLIP_FRAMES:
            raise SettingsError(f"motion {name}: {len(motion)} frames; at most {MAX_CLIP_FRAMES} fit into a page")
        try:
            with warnings.catch_warnings():
                if not chosen:
                    warnings.simplefilter("ignore", CarigsWarning)
                frames = driven_parameters(sequence, motion, driver)
        except CarigsError:
            if chosen:
                raise
            continue  # a head that cannot do what nobody has asked for
        clips.append(PageClip(name, motion.fps, frames, _sound(sounds[name]) if name in sounds else None))
    return clips


def _sound(file: Path) -> str:
    kind = SOUNDS.get(file.suffix.lower())
    if kind is None:
        raise InputError(f"a sound is one of {', '.join(SOUNDS)}", file=file)
    return f"data:{kind};base64,{base64.b64encode(read_bytes(file, MAX_SOUND, 'sound')).decode()}"


def _page(
    avatar: HeadAvatar, clip: list[int], regions: dict[str, GammaPath], clips: list[PageClip], title: str,
    first_level: float, fps: float,
) -> str:  # fmt: skip
    sequence = avatar.avatar.sequence
    head, arrays = head_arrays(sequence, clip, regions)
    light_header, factors, light = light_arrays(sequence, clip, regions)
    drive, moving = drive_arrays(sequence, clip[0], clips, light)
    layouts, content = deflated([*arrays, *factors, *moving, *surfel_arrays(avatar.avatar)])
    vertices = sequence.posed(clip[0], 0.0)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    header = head | light_header | drive | {
        "arrays": layouts,
        "skinning": avatar.avatar.skinning,
        "rotateHarmonics": avatar.avatar.rotate_harmonics,
        "background": avatar.avatar.background,
        "middle": (0.5 * (low + high)).tolist(),
        "extent": float((high - low).max()),
        "firstLevel": first_level,
        "fps": fps,
    }  # fmt: skip
    here = Path(__file__)
    texts = {name: here.with_name(f"page.{name}.js").read_text("utf-8") for name in (*WORKER, *SCRIPT)}
    style, script = here.with_name("page.css").read_text("utf-8"), "".join(texts[name] for name in SCRIPT)
    policy = (
        f"default-src 'none'; img-src data:; media-src data:; style-src {_digest(style)}; "
        f"script-src {_digest(script)}; worker-src blob:; base-uri 'none'; form-action 'none'"
    )
    template = Environment(autoescape=True, undefined=StrictUndefined).from_string(
        here.with_name("page.html.jinja").read_text("utf-8")
    )
    return template.render(
        title=title,
        description=f"{len(avatar.avatar.surfels):,} surfels",
        seen=avatar.avatar.seen,
        policy=policy,
        style=style,
        script=script,
        worker="".join(texts[name] for name in WORKER),
        shaders={name: here.with_name(f"page.{file}").read_text("utf-8") for name, file in SHADERS.items()},
        header=json.dumps(header).replace("<", "\\u003c"),
        data=base64.b64encode(content).decode(),
        sounds={clip.name: clip.sound for clip in clips if clip.sound},
        poster=_poster(avatar, clip[0], first_level),
        dark=avatar.avatar.background < 0.5,
    )


def _poster(avatar: HeadAvatar, timestep: int, level: float) -> str:
    """Picture for browsers that cannot draw the avatar, as a data URI."""
    (camera,) = orbit(avatar, 1, size=POSTER_SIZE)
    pixels = np.rint(255 * avatar.render(camera, level=level, timestep=timestep)).astype(np.uint8)
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "webp", quality=85)
    return f"data:image/webp;base64,{base64.b64encode(file.getvalue()).decode()}"


def _digest(text: str) -> str:
    return f"'sha256-{base64.b64encode(sha256(text.encode()).digest()).decode()}'"
