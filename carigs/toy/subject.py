"""The procedural person: head model, identity, texture, hair - everything its true images need."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32, Int

from carigs.errors import InputError
from carigs.files import writing
from carigs.head import HeadModel, HeadParameters, neutral, pose
from carigs.settings import Toy
from carigs.toy.look import teeth
from carigs.toy.look.atlas import Atlas, layout, texel_points
from carigs.toy.look.exposure import exposure
from carigs.toy.look.hair import Strands, grow
from carigs.toy.look.paint import paint_eyeball, paint_skin
from carigs.toy.rig.head_model import MILLIMETRE, head_model
from carigs.toy.rig.regions import above_hairline
from carigs.toy.rig.traits import Traits, draw
from carigs.toy.shape.field import EYE_X, EYE_Y, EYE_Z
from carigs.toy.shape.template import Template, template

_CHUNK = 1 << 15


@dataclass(frozen=True)
class Subject:
    """What `render_subject` needs; every array is a function of the settings."""

    model: HeadModel
    shape: Float[np.ndarray, "300"]
    supersampling: int
    atlas: Atlas
    strands: Strands
    exposure: Float32[np.ndarray, "v"]
    """Ambient light that reaches each vertex of the neutral face, in [0, 1]."""
    teeth: Float32[np.ndarray, "t 3"]
    """Vertices on the template, metres: the upper jaw's, then the lower jaw's."""
    teeth_faces: Int[np.ndarray, "g 3"]
    teeth_colours: Float32[np.ndarray, "t 3"]
    upper_teeth: int
    """How many of the vertices are the upper jaw's."""

    @cached_property
    def posed_model(self) -> HeadModel:
        """The head model with the teeth behind its vertices."""
        return teeth.with_teeth(self.model, self.teeth, self.upper_teeth)

    def save(self, file: Path) -> None:
        """Write all but the head model, which has its own file."""
        arrays: dict[str, np.ndarray] = {}
        for item in fields(self):
            value = getattr(self, item.name)
            if item.name == "model":
                continue
            if isinstance(value, Atlas | Strands):
                arrays |= {f"{item.name}.{name}": array for name, array in value._asdict().items()}
            else:
                arrays[item.name] = np.asarray(value)
        with writing(file) as part:
            np.savez_compressed(part, **arrays)


def make_subject(settings: Toy) -> Subject:
    """The person of a seed (some seconds: the template, the texture, the hair)."""
    shape, model, traits = template(), head_model(), draw(settings.seed)
    mouth, mouth_faces, mouth_colours, upper = teeth.jaws()
    return Subject(
        model=model,
        shape=traits.shape,
        supersampling=settings.supersampling,
        atlas=_texture(shape, traits, settings.texture_size**2),
        strands=grow(shape, traits, settings.hair_strands),
        exposure=_exposure(model, traits),
        teeth=(mouth * MILLIMETRE).astype(np.float32),
        teeth_faces=mouth_faces.astype(np.int32),
        teeth_colours=mouth_colours.astype(np.float32),
        upper_teeth=upper,
    )


def load_subject(folder: Path) -> Subject:
    """Read `subject.npz` and `head_model.npz`; raises `InputError` if they are missing or no such files."""
    file = Path(folder) / "subject.npz"
    model = HeadModel.load(Path(folder) / "head_model.npz")
    try:
        with np.load(file, allow_pickle=False) as archive:
            arrays = dict(archive.items())
        values = {name: array for name, array in arrays.items() if "." not in name}
        groups = {
            name: kind(**{part: arrays[f"{name}.{part}"] for part in kind._fields})
            for name, kind in (("atlas", Atlas), ("strands", Strands))
        }
        whole = {name: int(values.pop(name)) for name in ("supersampling", "upper_teeth")}
        return Subject(model=model, **values, **groups, **whole)
    except FileNotFoundError as error:
        raise InputError("no such subject; write the toy capture first", file=file) from error
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise InputError(f"not a toy subject ({error})", file=file) from error


def _exposure(model: HeadModel, traits: Traits) -> Float32[np.ndarray, "v"]:
    """On the neutral face; inside the mouth, which only shows when it is open, on the open mouth."""
    closed = HeadParameters(shape=traits.shape)
    free = exposure(neutral(model, closed), model.faces)
    inside = model.regions["lip_inside"]
    opened = pose(model, replace(closed, jaw=np.array([0.22, 0.0, 0.0])))
    free[inside] = np.maximum(exposure(opened, model.faces)[inside], 0.06)
    return free


def _texture(shape: Template, traits: Traits, budget: int) -> Atlas:
    corners = shape.vertices[shape.faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    middle = corners.mean(axis=1)
    left, right = shape.left_eye[shape.faces[:, 0]], shape.right_eye[shape.faces[:, 0]]
    # Finer texels where one looks; the scalp is under the hair.
    value = np.where(middle[:, 2] > 30, 2.0, 1.0) * np.where(above_hairline(middle) > 6, 0.5, 1.0)
    value = np.where(left | right, np.where(middle[:, 2] > EYE_Z + 6, 4.0, 1.0), value)
    first, resolution, _ = layout(longest * value, budget)
    points = texel_points(corners, resolution)
    centre = np.array([EYE_X, EYE_Y, EYE_Z])
    owner = np.repeat(left * 1 + right * 2, (resolution + 1) * (resolution + 2) // 2)
    texels = np.empty((len(points), 4), np.uint8)

    def paint(start: int) -> None:
        part, who = points[start : start + _CHUNK], owner[start : start + _CHUNK]
        colours = np.empty((len(part), 4), np.float32)
        colours[who == 0] = paint_skin(part[who == 0], traits)
        for eye, sign in ((1, 1.0), (2, -1.0)):
            here = part[who == eye] - (centre * [sign, 1, 1]).astype(np.float32)
            colours[who == eye] = paint_eyeball(here, traits)
        texels[start : start + _CHUNK] = np.rint(colours * 255)

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(paint, range(0, len(points), _CHUNK)))
    return Atlas(first, resolution, texels)
