"""The procedural subject: head model, identity, texture and hair, all that its reference images need."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float32, Int

from carigs.errors import InputError
from carigs.head import HeadModel, HeadParameters, flame_joints, neutral, pose
from carigs.readers.arrays import checked_array
from carigs.readers.npz import read_npz
from carigs.settings import Toy
from carigs.system.files import writing
from carigs.toy.look.ambient_visibility import ambient_visibility
from carigs.toy.look.atlas import Atlas, allocate_texels, texel_count, texel_points
from carigs.toy.look.hair import grow_hair
from carigs.toy.look.procedural_texture import eyeball_texture, skin_texture
from carigs.toy.look.shirt import Shirt, make_shirt
from carigs.toy.look.strands import RootedStrands, smooth_frames, triangle_frames
from carigs.toy.look.teeth import attach_teeth, build_teeth
from carigs.toy.rig.attributes import Attributes, sample_attributes
from carigs.toy.rig.head_model import METRES_PER_MILLIMETRE, head_model
from carigs.toy.rig.regions import height_above_hairline
from carigs.toy.shape.anatomy import EYE_CENTRE, EYE_Z
from carigs.toy.shape.template import Template, build_template

LONG_HAIR_RADIUS = 0.03
"""Metres over which the rotations of the triangles that carry long strands are averaged."""
_CHUNK = 1 << 15  # texels
_KEYS = {"ambient_visibility": "exposure"}  # keys in the file that differ from the field's name
_GROUPS = {"atlas": Atlas, "strands": RootedStrands, "shirt": Shirt}  # fields whose arrays have a key each


@dataclass(frozen=True)
class ToySubject:
    """The arrays that `render_subject` needs; all are functions of the settings."""

    model: HeadModel
    shape: Float[np.ndarray, "300"]
    """Identity coefficients."""
    supersampling: int
    """Samples per pixel and axis."""
    atlas: Atlas
    strands: RootedStrands
    long_hair: bool
    """Whether the rotations of the triangles that carry strands are averaged."""
    ambient_visibility: Float32[np.ndarray, " v"]
    """Ambient visibility of each vertex on the neutral face, in [0, 1]."""
    teeth: Float32[np.ndarray, "t 3"]
    """Vertices of the teeth on the template, in metres: upper jaw first."""
    teeth_faces: Int[np.ndarray, "g 3"]
    teeth_colours: Float32[np.ndarray, "t 3"]
    """sRGB in [0, 1]."""
    upper_teeth: int
    """Number of vertices of the upper jaw."""
    shirt: Shirt | None = None

    @cached_property
    def model_with_teeth(self) -> HeadModel:
        """The head model with the teeth appended to its vertices."""
        return attach_teeth(self.model, self.teeth, self.upper_teeth)

    def strand_frames(self, vertices: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "s 3 3"]:
        """Frames of the strands on a posed head.

        Args:
            vertices: World points in metres.

        Returns:
            Axes as rows.
        """
        faces, roots = self.model.faces, self.strands.face
        if self.long_hair:
            return smooth_frames(self.model.v_template, vertices, faces, roots, LONG_HAIR_RADIUS)
        return triangle_frames(vertices, faces)[roots]

    def save(self, file: Path) -> None:
        """Write everything except the head model, which has its own file.

        Args:
            file: The .npz file to write.
        """
        arrays: dict[str, np.ndarray] = {}
        for name in (field.name for field in fields(self) if field.name != "model"):
            value = getattr(self, name)
            if value is None:  # no shirt
                continue
            if name in _GROUPS:
                arrays |= {f"{name}.{part}": array for part, array in value._asdict().items()}
            else:
                arrays[_KEYS.get(name, name)] = np.asarray(value)
        with writing(file) as part:
            np.savez_compressed(part, **arrays)


def make_subject(settings: Toy) -> ToySubject:
    """Build the subject of a seed; takes some seconds.

    Args:
        settings: Seed, size of the texture, hair, shirt, supersampling.

    Returns:
        The subject.
    """
    template, model, attributes = build_template(), head_model(), sample_attributes(settings.seed)
    teeth, teeth_faces, teeth_colours, upper_teeth = build_teeth()
    return ToySubject(
        model=model,
        shape=attributes.shape,
        supersampling=settings.supersampling,
        atlas=_texture(template, attributes, settings.texture_size**2),
        strands=grow_hair(template, attributes, settings.hair_strands, long=settings.hair == "long"),
        long_hair=settings.hair == "long",
        ambient_visibility=_ambient_visibility(model, attributes),
        teeth=(teeth * METRES_PER_MILLIMETRE).astype(np.float32),
        teeth_faces=teeth_faces.astype(np.int32),
        teeth_colours=teeth_colours.astype(np.float32),
        upper_teeth=upper_teeth,
        shirt=make_shirt(model, HeadParameters(shape=attributes.shape), settings.seed) if settings.shirt else None,
    )


def load_subject(folder: Path) -> ToySubject:
    """Read the subject of a capture that `write_capture` has written.

    Args:
        folder: Folder with `subject.npz` and `head_model.npz`.

    Returns:
        The subject.

    Raises:
        InputError: A file is missing or has another format.
    """
    file = Path(folder) / "subject.npz"
    model = HeadModel.load(Path(folder) / "head_model.npz")
    arrays = read_npz(file, "subject; write the toy capture first")

    def take(name: str, *shape: int | None, dtype: type = np.float32, below: int | None = None) -> Any:
        return checked_array(arrays, name, shape, dtype, below=below, file=file)

    v, f = len(model.v_template), len(model.faces)
    teeth, local = take("teeth", None, 3), take("strands.local", None, None, 3)
    t, (s, k) = len(teeth), local.shape[:2]
    atlas = Atlas(
        take("atlas.first", f, dtype=np.int64),
        take("atlas.resolution", f, dtype=np.int64, below=1 << 15),
        take("atlas.texels", None, 4, dtype=np.uint8),
    )
    last = atlas.first + texel_count(atlas.resolution)
    if (atlas.resolution < 1).any() or (atlas.first < 0).any() or last.max(initial=0) > len(atlas.texels):
        raise InputError(f"names texels beyond 0..{len(atlas.texels) - 1}", file=file, field="atlas.first")
    if (supersampling := int(take("supersampling", dtype=np.int64, below=17))) == 0:
        raise InputError("must be at least 1", file=file, field="supersampling")
    strands = RootedStrands(
        take("strands.face", s, dtype=np.int64, below=f),
        take("strands.barycentric", s, 3, dtype=np.float64),
        local,
        take("strands.width", s),
        take("strands.colour", s, 3),
        take("strands.shade", s, k),
    )
    shirt = None
    if "shirt.vertices" in arrays:
        c = len(vertices := take("shirt.vertices", None, 3))
        cloth = take("shirt.faces", None, 3, dtype=np.int32, below=c), take("shirt.colours", c, 3)
        shirt = Shirt(vertices, *cloth, take("shirt.visibility", c))
    return ToySubject(
        model=model,
        shape=take("shape", 300, dtype=np.float64),
        supersampling=supersampling,
        atlas=atlas,
        strands=strands,
        long_hair=bool(take("long_hair", dtype=bool)),
        ambient_visibility=take("exposure", v),
        teeth=teeth,
        teeth_faces=take("teeth_faces", None, 3, dtype=np.int32, below=t),
        teeth_colours=take("teeth_colours", t, 3),
        upper_teeth=int(take("upper_teeth", dtype=np.int64, below=t + 1)),
        shirt=shirt,
    )


def _ambient_visibility(model: HeadModel, attributes: Attributes) -> Float32[np.ndarray, " v"]:
    """Ambient visibility on the neutral face; inside the mouth, which shows when it is open, on the open mouth."""
    closed = HeadParameters(shape=attributes.shape)
    visibility = ambient_visibility(neutral(model, closed), model.faces)
    inside = model.regions["lip_inside"]
    opened = pose(model, replace(closed, joints=flame_joints(jaw=[0.22, 0.0, 0.0])))
    visibility[inside] = np.maximum(ambient_visibility(opened, model.faces)[inside], 0.06)
    return visibility


def _texture(template: Template, attributes: Attributes, budget: int) -> Atlas:
    """Texture of at most `budget` texels."""
    corners = template.vertices[template.faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    middle = corners.mean(axis=1)
    left, right = template.left_eye[template.faces[:, 0]], template.right_eye[template.faces[:, 0]]
    # Finer on the face and in front of the eyeballs, coarser on the scalp, which is under the hair.
    density = np.where(middle[:, 2] > 30, 2.0, 1.0) * np.where(height_above_hairline(middle) > 6, 0.5, 1.0)
    density = np.where(left | right, np.where(middle[:, 2] > EYE_Z + 6, 4.0, 1.0), density)
    first, resolution, _ = allocate_texels(longest * density, budget)
    points = texel_points(corners, resolution)
    owner = np.repeat(left * 1 + right * 2, texel_count(resolution))  # 0 head, 1 left eyeball, 2 right eyeball
    texels = np.empty((len(points), 4), np.uint8)

    def fill(start: int) -> None:
        part, owners = points[start : start + _CHUNK], owner[start : start + _CHUNK]
        values = np.empty((len(part), 4), np.float32)
        values[owners == 0] = skin_texture(part[owners == 0], attributes)
        for eye, centre in ((1, EYE_CENTRE), (2, EYE_CENTRE * [-1, 1, 1])):
            values[owners == eye] = eyeball_texture(part[owners == eye] - centre.astype(np.float32), attributes)
        texels[start : start + _CHUNK] = np.rint(values * 255)

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(fill, range(0, len(points), _CHUNK)))
    return Atlas(first, resolution, texels)
