"""Diagnosis by trying: which of the usual mistakes, once undone, makes the capture fit its images?

All hypotheses are screened by silhouettes alone on a part of the scene; the best ones are compared by silhouettes and
colours on all of it. Pairs of mistakes are tried only if no single one mends the capture.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import numpy as np

from carigs.capture import Camera
from carigs.errors import InputError
from carigs.plausibility.diagnosis.camera_exchange import exchanged_cameras
from carigs.plausibility.diagnosis.hypotheses import HYPOTHESES, Hypothesis
from carigs.plausibility.diagnosis.reprojection import Reprojection, reproject
from carigs.plausibility.diagnosis.scene import Scene
from carigs.plausibility.findings import Finding
from carigs.plausibility.vertex_misfit import CLIP

CLEARLY = 0.75
"""A hypothesis is believed if it leaves less than this share of the misfit. What is no mistake leaves more than all."""
MENDED = 0.05
"""Share of the silhouettes outside the mattes in a capture that is mended; 0.001 in sound ones."""
UNUSABLE = 0.25
"""Silhouette misfit due to a mistake, beyond which nothing can be made of a capture as it is stated."""
PAIRS_FROM = 0.15
"""Silhouette misfit from which two mistakes are supposed. Sound captures with long hair reach 0.08."""
SCREENED = 12
"""Number of shots on which all hypotheses are screened (half of it for pairs of mistakes), ..."""
FINALISTS = 6
"""... and of hypotheses that are compared on all shots."""
PAIRED = ("axes", "units", "intrinsics", "images")
"""Groups of which two mistakes may come together."""
COLOUR_NOISE, OUTLINE_NOISE = 1.0, 0.01
"""Misfits below which differences mean little: levels of 255, and share of the pixels of a silhouette."""


class Diagnosis(NamedTuple):
    """The best explanation of a capture that does not fit its images."""

    mistakes: tuple[Hypothesis, ...]
    """Empty if none of the hypotheses explains the images clearly better than the capture as stated."""
    stated: Reprojection
    mended: Reprojection

    @property
    def share(self) -> float:
        """Misfit that is left, as a share of that of the capture as stated."""
        cameras = self.mistakes[0].cameras if self.mistakes else frozenset()
        stated, mended = (
            (r.silhouette_of(cameras) + OUTLINE_NOISE) * (r.colour + COLOUR_NOISE) for r in (self.stated, self.mended)
        )
        return mended / stated

    @property
    def is_unusable(self) -> bool:
        """Whether the mesh as stated is elsewhere than the head in the images."""
        return self.stated.silhouette - self.mended.silhouette > UNUSABLE

    @property
    def problem(self) -> str:
        """What is wrong."""
        return "; ".join(mistake.mistake for mistake in self.mistakes)

    @property
    def remedy(self) -> str:
        """What to do about it."""
        return "; ".join(f"{mistake.field}: {mistake.remedy}" for mistake in self.mistakes)

    @property
    def field(self) -> str:
        """Where it is wrong."""
        return ", ".join(dict.fromkeys(mistake.field for mistake in self.mistakes))

    def error(self, root: Path) -> InputError:
        """The mistakes as an error.

        Args:
            root: Folder of the capture.

        Returns:
            The error: nothing can be made of the capture as stated.
        """
        return InputError(f"{self.problem} ({self.evidence})", file=root, field=self.field, remedy=self.remedy)

    def finding(self, root: Path) -> Finding:
        """The mistakes as a finding.

        Args:
            root: Folder of the capture.

        Returns:
            The finding.
        """
        return Finding(self.problem, root, self.field, self.evidence, self.remedy)

    @property
    def evidence(self) -> str:
        """The figures."""
        stated, mended = self.stated, self.mended
        return (
            f"undone, the misfit of the silhouettes is {mended.silhouette:.3f} instead of {stated.silhouette:.3f}, "
            f"that of the colours {mended.colour:.1f} instead of {stated.colour:.1f} levels"
        )


def diagnose(scene: Scene) -> Diagnosis:
    """Find the mistake that explains the images of a scene.

    Args:
        scene: The scene as stated.

    Returns:
        The diagnosis. Without mattes there is none: a mesh that covers nothing but background has equal colours.
    """
    stated = reproject(scene)
    nothing = Diagnosis((), stated, stated)
    if not stated.overlaps:
        return nothing
    singles = [(hypothesis,) for hypothesis in (*HYPOTHESES, *exchanged_cameras(scene))]
    best = _best(scene, singles, SCREENED, nothing)
    if not best.mistakes and stated.silhouette > PAIRS_FROM:
        usual = [hypothesis for hypothesis in HYPOTHESES if hypothesis.group in PAIRED]
        pairs = [pair for pair in combinations(usual, 2) if pair[0].group != pair[1].group]
        best = _best(scene, pairs, SCREENED // 2, nothing)
    return best


def _best(
    scene: Scene, candidates: Sequence[tuple[Hypothesis, ...]], screened_shots: int, nothing: Diagnosis
) -> Diagnosis:
    part, screened = scene.spread(screened_shots), []
    for i, mistakes in enumerate(candidates):
        undone = _undone(part, mistakes)
        if all(_is_possible(shot.camera) for shot in undone.shots):
            screened.append((reproject(undone, colours=False).silhouette, i))
    screened.sort()
    finalists = {i for _, i in screened[:FINALISTS]}
    finalists |= {i for _, i in screened if candidates[i][0].group in ("time", "exchange")}
    found = [nothing]
    for i in sorted(finalists):
        undone = _undone(scene, candidates[i])
        if len(undone.shots) > len(scene.shots) / 2:
            found.append(Diagnosis(candidates[i], nothing.stated, reproject(undone)))
    best = min(found, key=lambda diagnosis: round(math.log(diagnosis.share), 2))  # equal ones differ by rounding
    is_mended = best.mended.outside_share < MENDED and best.mended.colour < CLIP
    return best if best.share < CLEARLY and is_mended else nothing


def _undone(scene: Scene, mistakes: Iterable[Hypothesis]) -> Scene:
    for mistake in mistakes:
        scene = mistake.undo(scene)
    return scene


def _is_possible(camera: Camera) -> bool:
    """Whether a camera has a focal length and does not mirror: then only one of several equal hypotheses is left."""
    return min(camera.fx, camera.fy) > 0 and np.linalg.det(camera.camera_from_world[:3, :3]) > 0
