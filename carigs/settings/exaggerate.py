"""Settings of the exaggeration."""

from __future__ import annotations

from dataclasses import dataclass

from carigs.settings.option import Section, option, set_by

DEFAULT_GAMMA = 0.25
"""gamma_f of the paper."""
USEFUL_LEVEL = 1.0
"""Beyond it a fifth of the faces turn over (docs/exaggeration.md)."""


@dataclass
class Exaggerate(Section, key="exaggerate"):
    """The caricature surface: the curvature-weighted Poisson equation, or a mesh from a file."""

    file: str | None = option(None, is_path=True)
    """A deformed mesh of the same topology, or an .npz with its displacement `delta` (V, 3): level gamma_f of a
    straight path. `{gamma}` in the name is replaced by the level that it stands for. Null: the equation is solved."""
    gamma: float = set_by("gamma", DEFAULT_GAMMA, ge=-100, le=100)
    """gamma_f, the level that is trained for."""
    curvature_floor: float = option(0.3, unit="K_ref", gt=0, le=1e6)
    """eps in |K|_eps = sqrt(K^2 + eps^2)."""
    curvature_smoothing: float = option(0.005, unit="bounding-box diagonals", ge=0, le=1)
    """Length over which curvature is smoothed by a heat step (0: not smoothed)."""
    curvature_source: str = option("subject", choices=("subject", "ratio", "template"))
    """The face that the curvature is taken from. `subject`: the subject's. `ratio`: the subject's relative to the head
    model's mean face, so that only individual features grow. `template`: the mean face's, which gives all subjects
    the same displacement (the paper)."""
    limit_cavities: bool = True
    """Reduce weights by ambient occlusion and stiffen occluded triangles, so that nostrils, ear canals and mouth do not
    grow through the skin, and do not fold."""
    gap_stiffness: float = option(20.0, ge=0, le=1e6)
    """Stiffness across narrow gaps relative to the skin's (0: none), so that lips and lids do not intersect."""
    normalize_weights: bool = True
    """Divide |K| by K_ref, and the weights by their area mean: the result does not depend on the unit of the mesh, and
    the overall size stays."""
    rigid_components: bool = True
    """Small components (eyeballs) follow their surroundings by a similarity."""
    blendshape_transfer: str = option("mixed", choices=("offset", "linear", "mixed"))
    """Blendshapes of the caricature. `offset`: unchanged. `linear`: exaggerated like the head. `mixed`: half of both,
    so that lids close. Always `offset` for a caricature from a file."""
    border_fade: float = option(0.0, unit="m", ge=0, le=1)
    """Distance from the border of the neck over which the caricature fades to the natural head, so that it stays on the
    shoulders (0: the neck is exaggerated, too). A caricature from a file does not fade."""
    path_nodes: int = option(0, ge=0, le=64, excluded=1)
    """Levels at which the path is solved (0: as many as keep the interpolation between them exact to 1e-4 bounding-box
    diagonals); 2 is the paper's linear blend."""
    region_constraint: str = option("soft", choices=("soft", "exact", "literal"))
    """How the rest is held in an edit of one region alone (`carigs mesh --gamma 0 --region`, `LocalEdit`; for `regions`
    the whole head is solved at once). `soft`: screened, with a smooth level. `exact`: fixed, with a smooth level.
    `literal`: fixed, and the weights do not fade (equation 4)."""
    regions: dict[str, float] = option({}, ge=-100, le=100)
    """Levels of single regions of the head model instead of gamma, for example `{nose: 0.4, ears: 0}`."""
