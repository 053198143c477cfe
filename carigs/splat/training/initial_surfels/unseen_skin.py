"""Skin that no training frame shows, such as the back of a head in front of one camera.

No frame tells a training how this skin looks. The little light that surfels in front of it let through would turn it
into noise, because Adam makes steps of one size from gradients of any size. So opaque discs in the colours around
cover it before the training, which leaves them as they are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_array

from carigs.capture import Capture
from carigs.capture.evenly_spread import evenly_spread
from carigs.hair.harmonic_faces import faces_beside, harmonic_faces
from carigs.head.facial_regions import EYEBALLS, MOUTH, eye_and_brow_faces
from carigs.mesh.ambient_occlusion import ambient_occlusion
from carigs.mesh.triangle_mesh import boundary_vertices
from carigs.raster.seen_triangles import seen_triangles
from carigs.settings.regions import Regions
from carigs.splat.rig.head_sequence import HeadSequence

FRAMES = 64
"""Most training frames that are looked at, evenly spread: a head turns little between them, and the rings next to what
they show are trained."""
UNSEEN, WELL_SEEN = 0.1, 0.5
"""Cosine between normal and direction to the camera, the largest of all frames: up to the first, a triangle counts as
unseen; from the second on, its colours are continued where others are missing."""
ENCLOSED = 0.8
"""Share of the directions blocked by the head itself from which on a triangle lies inside: in the mouth, in sockets."""
INSIDE_MATTE = 0.5
"""Mean matte of the skin around from which on unseen skin is drawn; where mattes are cut off, as at a collar, it is
left out."""
COVERING, LEFT_OUT = 0.98, 0.01
"""Opacity of discs that cover unseen skin, and of those on skin that is left out."""
KEPT_SCALE, LIFTED_SCALE = 0.5, 0.7
"""Standard deviation of discs that the training leaves as they are, in units of their triangles: on the skin, where
wider ones would reach over the outline, and in the height of the hair, where they lie farther apart."""
OUTLINE_RINGS = 2
"""Rings of triangles around those that frames show, and along the border of the mesh, which are trained, too:
outlines run there, and errors of the tracking move them."""
BORDER_RINGS = 4
"""Rings around the triangles that frames show within which the border of the mesh counts as an outline if the neck
goes on below it."""


@dataclass(frozen=True)
class Sight:
    """What training frames show of each triangle."""

    cosine: Float[np.ndarray, " f"]
    """Largest cosine between its normal and the direction to a camera that sees its centre; -1 if none does."""
    matte: Float[np.ndarray, " f"]
    """Mean of the mattes there; 0 if no camera sees it."""


@dataclass(frozen=True)
class UnseenSkin:
    """Triangles that no training frame shows, and how the skin around continues on them."""

    faces: Bool[np.ndarray, " f"]
    """The triangles."""
    kept: Bool[np.ndarray, " f"]
    """Those of them whose surfels the training leaves as they are: not those next to what frames show."""
    opacity: Float[np.ndarray, " f"]
    """Opacity of their discs."""
    well_seen: Bool[np.ndarray, " f"]
    """Triangles whose colours are continued."""
    scalp: Bool[np.ndarray, " f"]
    """Triangles that carry hair; hair and skin do not take each other's colours."""
    beside: csr_array
    """Which triangles share an edge."""
    cosine: Float[np.ndarray, " f"]
    """How well frames show the triangles (`Sight`)."""

    def continued(self, values: Float[np.ndarray, "f c"], known: Bool[np.ndarray, " f"]) -> Float[np.ndarray, "f c"]:
        """Continue values of well seen triangles over the others, harmonically: each is the mean of those beside.

        Args:
            values: Values of the triangles, such as colours.
            known: Triangles that have one.

        Returns:
            The values; those of well seen triangles are the same.
        """
        result, source = np.array(values, np.float64), known & self.well_seen
        for part in (self.scalp, ~self.scalp):
            # A part of which no frame shows anything takes the values around it.
            chosen = np.flatnonzero(part) if (source & part).any() else np.arange(len(part))
            filled = harmonic_faces(values[chosen], source[chosen], self.beside[chosen][:, chosen])
            result[part] = filled[part[chosen]]
        return result

    def with_kept(self, faces: Bool[np.ndarray, " f"], count: int) -> tuple[UnseenSkin, Bool[np.ndarray, " f"]]:
        """Keep some more triangles as they are.

        Args:
            faces: Triangles to choose from.
            count: How many are kept: those that frames show worst.

        Returns:
            The skin, and the triangles that were chosen.
        """
        mine = np.flatnonzero(faces)
        chosen = np.isin(np.arange(len(faces)), mine[np.argsort(self.cosine[mine], kind="stable")[:count]])
        return replace(self, kept=self.kept | chosen), chosen

    def height_of_hair(self, reach: Float[np.ndarray, " f"]) -> Float[np.ndarray, " f"]:
        """Continue the reach of the hair over the scalp that no frame shows, down to the skin around.

        Args:
            reach: How far hair reaches from each triangle of the scalp, in metres; 0 off the scalp.

        Returns:
            Height in metres above the triangles whose surfels are kept; 0 above the others.
        """
        return np.where(self.kept, harmonic_faces(reach, ~(self.scalp & self.kept), self.beside), 0)


def find_unseen_skin(
    capture: Capture, sequence: HeadSequence, regions: Regions, *, scalp: bool = True, has_body: bool = False
) -> UnseenSkin | None:
    """Find the outer skin that no training frame shows.

    Eyes, brows, lips, teeth and the inside of the mouth do not count: they are always seen in part, and have details
    that their surroundings do not tell.

    Args:
        capture: The capture.
        sequence: The subject.
        regions: Regions of the head model.
        scalp: Whether triangles that carry hair count, too. Where cameras stand around the head, its hair is seen, and
            covers them.
        has_body: Whether the neck goes on below the border of the mesh, which is no outline then.

    Returns:
        The triangles; None if frames show all of them, or nothing of the head.
    """
    head, vertices, faces = sequence.head, sequence.rig.vertices, sequence.rig.faces
    sight = look_at_triangles(capture, sequence)
    kept = head.face_region(*MOUTH, *EYEBALLS, "lips", "teeth", "tongue") | eye_and_brow_faces(head, vertices)
    hairy = head.face_region(*regions.hair)
    unseen = (sight.cosine <= UNSEEN) & ~kept
    if not scalp:
        unseen &= ~hairy
    if not unseen.any() or unseen.all():
        return None
    corners = np.isin(np.arange(len(vertices)), faces[unseen])
    unseen &= ambient_occlusion(vertices, faces, at=corners)[faces].mean(axis=1) < ENCLOSED
    if not unseen.any():
        return None
    beside = faces_beside(faces)
    matte = harmonic_faces(sight.matte, sight.cosine >= WELL_SEEN, beside)  # outlines are soft
    opacity = np.where(matte >= INSIDE_MATTE, COVERING, LEFT_OUT)
    border = boundary_vertices(faces, len(vertices))[faces].any(axis=1)
    seen = (sight.cosine > UNSEEN) | kept
    if has_body:  # what is far from all that frames show is no outline
        border &= _with_rings(faces, seen, BORDER_RINGS)
    inner = ~_with_rings(faces, seen | border)
    well_seen = (sight.cosine >= WELL_SEEN) & ~kept
    return UnseenSkin(unseen, unseen & inner, opacity, well_seen, hairy, beside, sight.cosine)


def _with_rings(
    faces: Int[np.ndarray, "f 3"], chosen: Bool[np.ndarray, " f"], count: int = OUTLINE_RINGS
) -> Bool[np.ndarray, " f"]:
    """Triangles, and rings around them."""
    for _ in range(count):
        chosen = np.isin(faces, faces[chosen]).any(axis=1)
    return chosen


def look_at_triangles(capture: Capture, sequence: HeadSequence) -> Sight:
    """Look at the triangles of the posed head in training frames.

    Args:
        capture: The capture.
        sequence: The subject.

    Returns:
        What the frames show.
    """
    faces = sequence.rig.faces
    cosine, matte, views = np.full(len(faces), -1.0), np.zeros(len(faces)), np.zeros(len(faces))
    for frame in evenly_spread(capture.split("train"), FRAMES):
        seen = seen_triangles(sequence.posed(frame.timestep, 0.0), faces, capture.camera(frame))
        cosine[seen.index] = np.maximum(cosine[seen.index], seen.cosine)
        matte[seen.index] += capture.foreground(frame)[seen.row, seen.column]
        views[seen.index] += 1
    return Sight(cosine, matte / np.maximum(views, 1))
