"""What a training knows of the hair: points for surfels, and the skin below that no image shows."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from carigs.hair import FoundHair, SpaceAboveSkin, hair_reach, place_in_hair
from carigs.head.facial_regions import brow_faces
from carigs.mesh.carried_points import CarriedPoints, nearest_triangles
from carigs.settings import Train
from carigs.splat.rig.head_sequence import HeadSequence
from carigs.splat.rig.rig import Rig
from carigs.splat.rig.smooth_motion import SmoothMotion, share_of_average
from carigs.splat.surfels.surfels import Surfels
from carigs.splat.training.initial_surfels.grafted_hair import GraftedHair

COVERED_POSITION, COVERED_SCALE = 1.0, 0.8
"""Largest distance from its triangle, and largest standard deviation, of a surfel on covered skin, in units of k."""
HIDDEN_OPACITY = 0.95
"""Opacity of hidden skin: where the caricature moves it out of the hair, it is seen."""
INSIDE, OPAQUE = 0.04, 0.7
"""Share of the views that counts for hair that none sees, and initial opacity, where views are far apart."""
FADING_STEPS, FADING = 50, 1.0
"""Steps after which surfels of hair over bare skin lose this much of the logit of their opacity."""


@dataclass(frozen=True)
class HairSurfels:
    """Hair in a training."""

    points: CarriedPoints
    """Where surfels of the hair start, and the triangles of the scalp that carry them."""
    scalp: Bool[np.ndarray, " f"]
    """Triangles that carry hair."""
    covered: Bool[np.ndarray, " f"]
    """Triangles of the skin that something covers."""
    hidden: Bool[np.ndarray, " f"]
    """Those of them that most views do not see."""
    skin: Bool[np.ndarray, " f"]
    """Triangles that show bare skin of the usual colour."""
    above_skin: SpaceAboveSkin
    """Space without hair."""
    reach: Float[np.ndarray, " f"]
    """How far hair reaches from each triangle of the scalp, in metres; 0 off the scalp."""
    grafts: GraftedHair | None = None
    """Copies of it where no frame shows hair; None if there are none."""

    @property
    def copies(self) -> int:
        """Number of copied points."""
        return 0 if self.grafts is None else len(self.grafts.source)

    @property
    def all_points(self) -> list[CarriedPoints]:
        """Where surfels of seen and of copied hair start."""
        return [self.points] if self.grafts is None else [self.points, self.grafts.points]

    def without(self, body: Bool[np.ndarray, " f"]) -> HairSurfels:
        """The same hair, which says nothing of some triangles.

        Args:
            body: Triangles that carry the body.

        Returns:
            Hair that neither covers nor hides them.
        """
        return replace(self, covered=self.covered & ~body, hidden=self.hidden & ~body)

    def keep_hidden_skin(self, surfels: Surfels) -> None:
        """Set the gradients of colours and opacities of hidden skin to zero: images show what covers it.

        Args:
            surfels: The surfels, with gradients.
        """
        inside = self.hidden[surfels.binding]
        for values in (surfels.colour, surfels.harmonics, surfels.opacity):
            if values.grad is not None:
                values.grad.numpy()[inside] = 0

    def keep_on_covered_skin(self, surfels: Surfels) -> None:
        """Keep the surfels of covered skin on their triangles, in place.

        They would explain the hair in front of them, and carry it along where the caricature moves the skin.

        Args:
            surfels: The surfels.
        """
        inside = self.covered[surfels.binding]
        position, log_scale = surfels.position.detach().numpy(), surfels.log_scale.detach().numpy()
        distance = np.linalg.norm(position[inside], axis=1, keepdims=True)
        position[inside] *= np.minimum(1, COVERED_POSITION / np.maximum(distance, 1e-9)).astype(np.float32)
        log_scale[inside] = np.minimum(log_scale[inside], np.float32(np.log(COVERED_SCALE)))

    def fade_over_bare_skin(self, surfels: Surfels, rig: Rig) -> None:
        """Make surfels of hair more transparent where there is no hair, in place.

        At level 0 they could take the place of the skin below; on the caricature they would not move with it.

        Args:
            surfels: The surfels.
            rig: The canonical mesh.
        """
        mine = np.flatnonzero(self.scalp[surfels.binding])
        face, local = surfels.binding[mine], surfels.position.detach().numpy()[mine].astype(np.float64)
        centre = rig.vertices[rig.faces[face]].mean(axis=1)
        position = centre + np.einsum("nij,nj->ni", rig.frame[face], local)
        surfels.opacity.detach().numpy()[mine[self.above_skin.contains(position)]] -= np.float32(FADING)


def keep_size_of_brows(sequence: HeadSequence, settings: Train) -> None:
    """Let the surfels of the brows keep their size, unless hair grows: brows are hair, which does not stretch.

    Their centres move with the skin. Nothing changes where the head model does not say where its brows are.

    Args:
        sequence: The subject; its rig changes.
        settings: Whether hair grows (`hair_grows`).
    """
    brows = brow_faces(sequence.head, sequence.head.v_template)
    if brows is not None and not settings.hair_grows:
        sequence.rig = sequence.rig.with_kept_size(brows)


def prepare_hair(
    found: FoundHair,
    scalp: Bool[np.ndarray, " f"],
    sequence: HeadSequence,
    settings: Train,
    kept: Bool[np.ndarray, " f"] | None = None,
    is_between: bool = False,
) -> HairSurfels | None:
    """Draw points inside the hair, and let the scalp move smoothly.

    Each view trains the hair that it sees, before a scalp of the same colour that hides how transparent it is. Views
    in between look past this scalp, through both layers. Where views are far apart, hair is filled and starts opaque.

    Args:
        found: The hair.
        scalp: Triangles that usually carry hair.
        sequence: The subject; receives the smooth motion.
        settings: Number of points over the number of triangles of the scalp (`hair_layers`), whether hair grows with
            the scalp (`hair_grows`), and the seed of the points.
        kept: Triangles that the training leaves as they are, which carry no hair; None if there are none.
        is_between: Whether the avatar will be seen from between views that are far apart.

    Returns:
        The hair; None if the head has none.
    """
    count = settings.hair_layers * int(scalp.sum())
    carrying = scalp if kept is None else scalp & ~kept
    if count == 0 or not carrying.any() or not found.has_hair(scalp):
        return None
    rng = np.random.default_rng([settings.seed, 1])
    vertices, faces = sequence.rig.vertices, sequence.rig.faces
    least = INSIDE if is_between else 0.0
    points = place_in_hair(found.volume, found.visible, found.strands, scalp, vertices, faces, count, rng, least)
    if is_between:
        points = points._replace(opacity=OPAQUE)
    reach = hair_reach(points, scalp, vertices, faces)
    sequence.smooth = SmoothMotion(sequence.rig, scalp, settings.hair_grows, share_of_average(reach))
    if not carrying[scalp].all():
        points = points._replace(face=nearest_triangles(points.position, np.flatnonzero(carrying), vertices, faces))
    bare = ~(found.covered | scalp)
    above_skin = SpaceAboveSkin(vertices, faces, bare)
    covered, hidden, skin = (part & ~scalp for part in (found.covered, found.hidden, found.skin))
    return HairSurfels(points, carrying, covered, hidden, skin, above_skin, reach)
