"""The subject of a training: how the head moves, its images, hair and body, and the inside of its mouth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool

from carigs.capture import Capture
from carigs.capture.splits import ENOUGH_CAMERAS
from carigs.capture.target_index import SHADING, TargetSet
from carigs.exaggeration import GammaPath
from carigs.hair import FoundHair, hair_shadow
from carigs.head.neck_border import neck_border
from carigs.light.shading import load_shading
from carigs.mesh.carried_points import CarriedPoints
from carigs.settings import Train
from carigs.splat.rig.head_sequence import HeadSequence, head_sequence
from carigs.splat.rig.solid_motion import Solid
from carigs.splat.training.initial_surfels.body_cover import COVER_CARRIERS, BodyCover, cover_body
from carigs.splat.training.initial_surfels.body_surfels import prepare_body
from carigs.splat.training.initial_surfels.grafted_hair import graft_hair
from carigs.splat.training.initial_surfels.hair_surfels import HairSurfels, keep_size_of_brows, prepare_hair
from carigs.splat.training.initial_surfels.mouth_surfels import prepare_mouth
from carigs.splat.training.initial_surfels.unseen_skin import UnseenSkin, find_unseen_skin
from carigs.splat.training.initial_surfels.view_spread import are_far_apart, same_from_all_sides
from carigs.splat.training.outlines import Outlines
from carigs.splat.training.supervision import Supervision


class TrainingSubject(NamedTuple):
    """How a head moves, its images, hair and body, and the inside of its mouth."""

    sequence: HeadSequence
    supervision: Supervision
    """Training frames and targets."""
    hair: HairSurfels | None = None
    """Where hair is; None if the head has none."""
    mouth: CarriedPoints | None = None
    """Where surfels inside the mouth start; None if there are none."""
    body: CarriedPoints | None = None
    """Where surfels of the body start; None if there are none."""
    body_cover: BodyCover | None = None
    """Discs on the body where no frame shows it; None if there are none."""
    unseen: UnseenSkin | None = None
    """Skin that no training frame shows; None if it is treated like the other."""

    same_from_all_sides: Bool[np.ndarray, " f"] | None = None
    """Triangles whose surfels have colours that do not depend on the view; None if no colours do."""

    @property
    def inside(self) -> list[CarriedPoints]:
        """Where surfels of mouth and body start, and those that cover the body, which come last."""
        cover = None if self.body_cover is None else self.body_cover.points
        return [points for points in (self.mouth, self.body, cover) if points is not None]

    @property
    def copies(self) -> int:
        """Number of points that cover what no frame shows, and whose surfels are not trained: copied hair, body."""
        cover = 0 if self.body_cover is None else len(self.body_cover.points.face)
        return cover + (0 if self.hair is None else self.hair.copies)


def prepare_subject(
    capture: Capture,
    path: GammaPath,
    settings: Train,
    hair: FoundHair | None = None,
    targets: Sequence[TargetSet] = (),
) -> TrainingSubject:
    """Prepare a training: its images, the motion and the light of the head, and the points where surfels start.

    Args:
        capture: The capture.
        path: Caricatures of its head.
        settings: Settings of the stage.
        hair: Where hair is; None if there is none.
        targets: GT* frames, one set per level. The light of all levels is that of the last set.

    Returns:
        The subject.
    """
    sequence = head_sequence(capture, path)
    if targets and settings.relight_surfels:
        sequence.shading = load_shading(targets[-1].folder / SHADING, len(capture.model.faces))
    has_body, closed = hair is not None and hair.body is not None, _is_closed(settings, capture)
    unseen = None
    if settings.cover_unseen != "none" and settings.start is None:
        unseen = find_unseen_skin(capture, sequence, settings.regions, scalp=closed, has_body=closed and has_body)
    body_carriers = None
    if has_body and closed and unseen is not None:
        border = neck_border(capture.model, sequence.rig.vertices)
        if border is not None:
            count = min(COVER_CARRIERS, int(border.carriers.sum()) // 2)
            unseen, body_carriers = unseen.with_kept(border.carriers, count)
    kept = None if unseen is None else unseen.kept
    used = targets if settings.gtstar_probability > 0 else ()
    outlines = Outlines(sequence, settings.outline_weight) if settings.outline_weight != 1 else None
    supervision = Supervision(capture, used, settings.mask_flags, kept=kept, outlines=outlines)
    keep_size_of_brows(sequence, settings)
    scalp = capture.model.face_region(*settings.regions.hair)
    if hair is not None and sequence.shading is not None:
        rig, extinction = sequence.rig, sequence.shading.extinction
        sequence.hair_shadow = hair_shadow(hair, scalp, rig.vertices, rig.faces, extinction)
    far_apart = are_far_apart(capture, sequence)
    hair_surfels = None if hair is None else prepare_hair(hair, scalp, sequence, settings, kept, far_apart)
    mouth = prepare_mouth(capture, sequence, settings)
    body, body_cover = None if hair is None else prepare_body(hair, sequence, settings, body_carriers), None
    if body is not None and body_carriers is not None:
        body_cover = cover_body(hair.body, body, body_carriers, capture, sequence)
    if body is not None and hair_surfels is not None:
        hair_surfels = hair_surfels.without(sequence.solids.solids == Solid.BODY)
    if hair_surfels is not None and unseen is not None:
        rng = np.random.default_rng([settings.seed, 5])
        grafts = graft_hair(hair_surfels.points, hair_surfels.reach, unseen, capture, sequence, rng)
        hair_surfels = replace(hair_surfels, grafts=grafts)
    same = same_from_all_sides(capture, sequence, scalp, far_apart) if settings.sh_degree else None
    return TrainingSubject(sequence, supervision, hair_surfels, mouth, body, body_cover, unseen, same)


def _is_closed(settings: Train, capture: Capture) -> bool:
    """Whether scalp and body are covered, too, where no frame shows them: the hair that many cameras see covers it."""
    if settings.cover_unseen == "auto":
        return len({frame.camera for frame in capture.split("train")}) < ENOUGH_CAMERAS
    return settings.cover_unseen == "all"
