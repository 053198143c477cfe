"""The hair of a subject: the triangles that it covers and the space that it fills, as a file."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float32

from carigs.capture import Capture, Frame
from carigs.errors import InputError
from carigs.hair.body import Body, carve_body, shows_body
from carigs.hair.covered_faces import covered_faces
from carigs.hair.hull import Voxels
from carigs.hair.labels import read_covering
from carigs.hair.strands import Strands, strand_directions
from carigs.hair.views import read_views, some_views
from carigs.hair.visible_voxels import visible_shares
from carigs.hair.volume import below_hair, carve_hair
from carigs.head import neutral
from carigs.head.facial_regions import EYEBALLS, MOUTH, brow_faces, lid_faces
from carigs.head.model_arrays import POSSIBLE
from carigs.head.neck_border import neck_border
from carigs.readers.arrays import checked_array
from carigs.readers.npz import read_npz
from carigs.settings import Hair
from carigs.system.files import writing

TEXTURE_LIMIT = 0.03
"""Contrast of what moves against a triangle, in sRGB values without the noise of the images, of a covered one."""
CLEAN_TEXTURE = 0.015
"""Texture of a triangle, see `Covering`, up to which its colours are those of the skin."""
HAIRY_SHARE = 0.1
"""A head is bald if something covers at most this share of its scalp."""


@dataclass(frozen=True)
class FoundHair:
    """What the frames of a capture show of the hair."""

    texture: Float32[np.ndarray, " f"]
    """Contrast of what moves against each triangle, see `Covering`."""
    covered: Bool[np.ndarray, " f"]
    """Whether something covers the triangle."""
    hidden: Bool[np.ndarray, " f"]
    """Whether hair does so in most views."""
    skin: Bool[np.ndarray, " f"]
    """Whether the triangle shows bare skin of the usual colour."""
    volume: Voxels
    visible: Float32[np.ndarray, " n"]
    """Share of the views that see each voxel of the volume."""
    strands: Strands
    body: Body | None = None
    """Neck below the mesh, shoulders and clothes; None if the frames show none."""

    @property
    def clean(self) -> Bool[np.ndarray, " f"]:
        """Triangles whose colours are those of the skin: not even single strands move over them."""
        return ~self.covered & (self.texture < CLEAN_TEXTURE)

    def has_hair(self, scalp: Bool[np.ndarray, " f"]) -> bool:
        """Whether the head has hair that stands off the scalp.

        Args:
            scalp: Triangles that usually carry hair.

        Returns:
            False for a bald head.
        """
        is_seen = (self.volume.opacity * self.visible).any()
        return bool(is_seen and (self.covered & scalp).sum() > HAIRY_SHARE * scalp.sum())

    def description(self, scalp: Bool[np.ndarray, " f"]) -> str:
        """What was found, in one line.

        Args:
            scalp: Triangles that usually carry hair.

        Returns:
            The line.
        """
        skin = self.covered[~scalp].mean() if not scalp.all() else 0.0
        hair = f"hair: fills {_litres(self.volume):.2f} litres"
        body = "" if self.body is None else f"; the body fills {_litres(self.body.volume):.1f} litres"
        return f"{hair}; {100 * skin:.1f} % of the triangles beside the scalp are covered{body}"

    def save(self, file: Path) -> None:
        """Write the file.

        Args:
            file: File to write (.npz).
        """
        arrays = {"texture": self.texture, "covered": self.covered, "hidden": self.hidden, "skin": self.skin}
        arrays |= {
            "visible": self.visible,
            "centres": self.volume.centres,
            "opacity": self.volume.opacity,
            "size": np.float32(self.volume.size),
        }
        arrays |= {f"strand_{name}": values for name, values in self.strands._asdict().items()}
        if self.body is not None:
            volume, visible = self.body
            arrays |= {"body_centres": volume.centres, "body_opacity": volume.opacity, "body_visible": visible}
        with writing(file) as part, part.open("wb") as stream:
            np.savez_compressed(stream, **arrays)


def find_hair(settings: Hair, capture: Capture, map_timesteps: Callable[..., Iterable] = map) -> FoundHair:
    """Find the hair in the training frames of a capture.

    Args:
        settings: Regions of the head, and the limit of the texture.
        capture: The capture.
        map_timesteps: `map`, or that of an executor; the result does not depend on it.

    Returns:
        The hair.

    Raises:
        InputError: If no training frame can be read, or no labels where a folder of labels is set.
    """
    model, frames = capture.model, capture.split("train")
    views = read_views(capture, map_timesteps, _label_reader(settings))
    if not views:
        problem = f"no training frame shows the head, for example {frames[0].name}: its image cannot be read, "
        remedy = "carigs check names what is wrong"
        raise InputError(f"{problem}or its camera lies in or before the head", file=capture.root, remedy=remedy)
    if settings.labels is not None and all(view.covering is None for view in views):
        raise InputError(f"no labels of training frames, such as {frames[0].name}.png", file=settings.labels)
    canonical = neutral(model, capture.parameters(frames[0].timestep))
    scalp, eyeballs = model.face_region(*settings.regions.hair), model.face_region(*EYEBALLS)
    mouth, brows = model.face_region(*MOUTH), brow_faces(model, canonical)
    features = lid_faces(model, canonical) | model.face_region("lips")
    if brows is not None:
        features |= brows
    covering = covered_faces(views, model.faces, canonical, scalp, eyeballs | mouth, features, TEXTURE_LIMIT)
    border = neck_border(model, canonical)
    if border is not None and not shows_body(views, border, canonical, model.faces):
        border = None
    volume = carve_hair(views, covering, scalp, canonical, model.faces, TEXTURE_LIMIT, border)
    body = None if border is None else carve_body(views, border, canonical, model.faces)
    some, carrier = some_views(views), np.unique(model.faces[scalp])
    visible = visible_shares(volume, some, canonical, carrier).astype(np.float32)
    strands = strand_directions(volume, some, canonical, carrier)
    # Stubble moves against the mesh like strands that hang over skin, but it is the skin that frames show.
    hidden = covering.hidden & below_hair(volume, canonical, model.faces)
    covered = covering.covered if border is None else covering.covered | border.carriers
    return FoundHair(
        covering.texture.astype(np.float32), covered, hidden, covering.skin, volume, visible, strands, body
    )


def _label_reader(settings: Hair) -> Callable[[Frame, tuple[int, int]], np.ndarray | None] | None:
    """What reads the pixels of a frame that labels call covering; None without labels."""
    if settings.labels is None:
        return None
    folder = Path(settings.labels)
    return lambda frame, size: read_covering(folder / f"{frame.name}.png", settings.label_classes, size)


def load_hair(file: Path, num_faces: int) -> FoundHair:
    """Read what `FoundHair.save` wrote.

    Args:
        file: The file.
        num_faces: Triangles of the head.

    Returns:
        The hair.

    Raises:
        InputError: The file is missing or malformed, or of another head.
    """
    arrays = read_npz(file, "hair")

    def take(name: str, shape: tuple[int | None, ...], low: float, high: float) -> Float32[np.ndarray, "..."]:
        return checked_array(arrays, name, shape, np.float32, within=(low, high), file=file)

    names = ("covered", "hidden", "skin")
    covered, hidden, skin = (checked_array(arrays, name, (num_faces,), bool, file=file) for name in names)
    centres = take("centres", (None, 3), *POSSIBLE)
    opacity, visible = (take(name, (len(centres),), 0, 1) for name in ("opacity", "visible"))
    volume = Voxels(centres, opacity, float(take("size", (), 1e-6, 1)))
    direction, facing = (take(f"strand_{name}", (len(centres), 3), -1.001, 1.001) for name in ("direction", "facing"))
    if not np.allclose(np.linalg.norm(direction, axis=1), 1, atol=1e-3):
        raise InputError("expected unit vectors", file=file, field="strand_direction")
    strands = Strands(direction, take("strand_confidence", (len(centres),), 0, 1), facing)
    body = None
    if "body_centres" in arrays:
        centres = take("body_centres", (None, 3), *POSSIBLE)
        opacity, shown = (take(f"body_{name}", (len(centres),), 0, 1) for name in ("opacity", "visible"))
        body = Body(Voxels(centres, opacity, volume.size), shown)
    return FoundHair(take("texture", (num_faces,), 0, 1), covered, hidden, skin, volume, visible, strands, body)


def _litres(volume: Voxels) -> float:
    return 1000 * float(volume.opacity.sum()) * volume.size**3
