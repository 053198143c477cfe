"""Settings of the exaggeration."""

from __future__ import annotations

from dataclasses import dataclass

from carigs.settings.option import Section, option

DEFAULT_GAMMA = 0.25
"""gamma_f of the paper."""


@dataclass
class Exaggerate(Section, key="exaggerate"):
    """The caricature surface: the curvature-weighted Poisson equation, or a mesh from a file."""

    source: str = option(
        "poisson",
        "`poisson` solves the equation; with `file` a deformed mesh of the same topology becomes level gamma_f"
        " of a straight path.",
        choices=("poisson", "file"),
    )
    file: str | None = option(
        None,
        "The deformed mesh, or an .npz with its displacement `delta` (V, 3); `{gamma}` in the name is replaced by the"
        " level that it stands for.",
        required_when=("source", "file"),
    )
    gamma: float = option(DEFAULT_GAMMA, "gamma_f, the level that is trained for.", ge=-100, le=100)
    curvature_floor: float = option(0.3, "eps in |K|_eps = sqrt(K^2 + eps^2).", "K_ref", gt=0)
    relative_curvature: bool = option(
        True, "Divide |K| by K_ref, so that the result does not depend on the unit of the mesh."
    )
    curvature_smoothing: float = option(
        0.005,
        "Length over which curvature is smoothed by a heat step (0: not smoothed).",
        "bounding-box diagonals",
        ge=0,
    )
    curvature_source: str = option(
        "subject",
        "The face that the curvature is taken from. `subject`: the subject's. `ratio`: the subject's relative to"
        " the head model's mean face, so that only individual features grow. `template`: the mean face's, which gives"
        " all subjects the same displacement (the paper).",
        choices=("subject", "ratio", "template"),
    )
    limit_cavities: bool = option(
        True,
        "Reduce weights by ambient occlusion, so that nostrils, ear canals and mouth do not grow through the skin.",
    )
    cavity_stiffness: float = option(
        4.0, "Additional stiffness of occluded triangles relative to open skin (0: none), against folding.", ge=0
    )
    gap_stiffness: float = option(
        20.0,
        "Stiffness across narrow gaps relative to the skin's (0: none), so that lips and lids do not intersect.",
        ge=0,
    )
    normalize_weights: bool = option(True, "Divide the weights by their area mean, which keeps the overall size.")
    rigid_components: bool = option(True, "Small components (eyeballs) follow their surroundings by a similarity.")
    blendshape_transfer: str = option(
        "mixed",
        "Blendshapes of the caricature. `offset`: unchanged. `linear`: exaggerated like the head. `mixed`: half of"
        " both, so that lids close. Always `offset` for a caricature from a file.",
        choices=("offset", "linear", "mixed"),
    )
    path_error: float = option(
        1e-4,
        "Largest interpolation error of the path between its nodes; determines their number.",
        "bounding-box diagonals",
        gt=0,
    )
    path_nodes: int = option(
        0,
        "Levels at which the path is solved (0: as many as `path_error` needs); 2 is the paper's linear blend.",
        ge=0,
        excluded=1,
    )
    region_constraint: str = option(
        "soft",
        "How the rest of the head is held when one region is exaggerated. `soft`: screened, with a smooth level."
        " `exact`: fixed, with a smooth level. `literal`: fixed, with a level that jumps (equation 4).",
        choices=("soft", "exact", "literal"),
    )
    regions: dict[str, float] = option(
        {},
        "Levels of single regions of the head model instead of gamma, for example `{nose: 0.4, ears: 0}`.",
        ge=-100,
        le=100,
    )
