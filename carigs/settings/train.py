"""Settings of the training."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any

from carigs.settings.edit import Edit
from carigs.settings.mask_flags import DEFAULT_MASK_FLAGS, MASK_FLAGS
from carigs.settings.option import MAX_COUNT, MAX_SEED, Section, option, set_by
from carigs.settings.regions import Regions

BUDGET, BUDGET_UNITS = r"([1-9][0-9]{0,8}(?:\.[0-9]{1,9})?) ?(s|min|h)", {"s": 1.0, "min": 60.0, "h": 3600.0}
"""A time from 1 of its unit on, and the seconds of the units."""
_FLAGS = "names of `carigs.settings.MaskFlag`"


@dataclass
class Density(Section, key="train.density"):
    """Density control with binding inheritance (the strategy of GaussianAvatars)."""

    start: int = option(300, ge=0, le=MAX_COUNT)
    """First step that may clone, split and prune."""
    stop: int = option(1500, ge=0, le=MAX_COUNT)
    """First step without density control."""
    every: int = option(200, ge=0, le=MAX_COUNT)
    """Steps between two refinements (0: no density control)."""
    gradient_threshold: float = option(0.0002, unit="NDC", ge=0, le=1e9)
    """Mean screen-space positional gradient above which a surfel is cloned or split."""
    prune_opacity: float = option(0.005, ge=0, le=1)
    """Opacity below which a surfel is removed."""
    max_surfels: int = option(60000, ge=1, le=10_000_000)
    """Budget of surfels, without copies of hair where no frame shows any, which do not learn."""
    replace_fraction: float = option(0.2, ge=0, le=1)
    """Fraction of the least important surfels that one refinement may replace once the budget is spent."""
    reset_every: int = option(0, ge=0, le=MAX_COUNT)
    """Steps between two opacity resets (0: none, which suits short trainings)."""


@dataclass
class RefineTracking(Section, key="train.refine_tracking"):
    """Refinement of the tracked head parameters on the real training frames by Adam."""

    until: float = option(0.0, ge=0, le=1)
    """Share of the training's steps, the first ones, that optimise pose and expression of the training frames along
    with the surfels (0: none). With 0.5, those of the other half settle on a head that stays."""
    translation_lr: float = option(6e-5, unit="metres", ge=0, lt=0.1)
    """Learning rate of the translation. That of head, neck, jaw and eye rotations is ten times as many radians: what is
    10 cm from a joint moves as far by either."""
    expression_lr: float = option(3e-3, ge=0, lt=1)
    """Learning rate of the expression coefficients."""


@dataclass
class Train(Section, key="train"):
    """Optimisation of the surfels."""

    iterations: int = option(1500, ge=1, le=MAX_COUNT)
    """Optimisation steps, one image each."""
    budget: str | None = option(None, pattern=BUDGET, pattern_name="a number with s, min or h, such as 60s")
    """CPU time of the steps instead of their number, such as `60s`, `5min` or `1h`: steps are measured on this machine
    before the first, and what else is given in steps (density control, regularizers) is scaled with their number. On a
    GPU it is wall time."""
    seed: int = set_by("seed", 0, ge=0, le=MAX_SEED)
    """Seed of the order of images and of density control."""
    regions: Regions = set_by("regions", Regions)
    """Regions of the head model."""
    gtstar_probability: float = option(0.12, ge=0, le=1)
    """Probability that a step is supervised by a GT* frame: 0 uses real frames only, 1 GT* frames only. A GT* frame
    takes the step of a real one, and says little more than where the outlines of a caricature are."""
    outline_weight: float = option(2.0, ge=1, le=100)
    """Factor on the gradient of pixels within 4 mm of the outline of the mesh in real frames; its square in GT* frames,
    which come less often (1: all pixels weigh the same)."""
    num_gtstar_levels: int = option(1, ge=1, le=64)
    """Number of levels with GT* frames, evenly spaced up to gamma (1: gamma alone)."""
    mask_flags: tuple[str, ...] = option(DEFAULT_MASK_FLAGS, choices=MASK_FLAGS, choices_name=_FLAGS)
    """Flags whose pixels of GT* frames are left out of the loss. Surfels on triangles that always carry one of them are
    frozen in GT* steps."""
    add_mask_flags: tuple[str, ...] = option((), choices=MASK_FLAGS, choices_name=_FLAGS)
    """Flags to add to `mask_flags`; empty afterwards."""
    remove_mask_flags: tuple[str, ...] = option((), choices=MASK_FLAGS, choices_name=_FLAGS)
    """Flags to remove from `mask_flags`; empty afterwards."""
    relight_surfels: bool = True
    """Colours follow the light that was fitted for the GT* frames, if any (`gtstar.relight`)."""
    start: str | None = option(None, is_path=True)
    """An avatar (.npz) of a head with the same triangles whose surfels the training starts from, such as one that
    `carigs convert` made; nothing: surfels on every triangle, coloured from the frames."""
    rig: str = option("jbs", choices=("jbs", "jacobian"))
    """`jbs`: Jacobian blend skinning. `jacobian`: the Jacobian of the own triangle alone."""
    sh_degree: int = option(0, ge=0, le=3)
    """Degree of the spherical harmonics of view-dependent colour."""
    rotate_harmonics: bool = True
    """Spherical harmonics rotate with the head instead of staying in world axes."""
    surfels_per_face: int = option(1, ge=1, le=1000)
    """Initial surfels on each triangle."""
    initial_scale: float = option(0.5, unit="triangle units", gt=0, le=100)
    """Initial standard deviation of the discs, divided by the square root of `surfels_per_face`."""
    initial_opacity: float = option(0.6, gt=0, lt=1)
    """Initial opacity of the surfels on triangles; at most 0.3 on eyeballs and lids, which hide each other, and on
    brows, whose details are finer than the triangles."""
    cover_unseen: str = option("auto", choices=("auto", "none", "skin", "all"))
    """Which skin gets opaque discs in the colours around it, if no training frame shows it, and on the scalp copies of
    the hair around it; the training leaves both as they are. `skin`: skin without hair, such as the nape. `all`: scalp
    and body, too. `auto`: scalp and body, too, before fewer than six cameras. `none`: nothing. Unseen skin without
    discs ends as noise."""
    hair_layers: int = option(6, ge=0, le=1000)
    """Surfels inside the hair, over the number of triangles of `regions.hair`."""
    mouth_surfels: int = option(3000, ge=0, le=1_000_000)
    """Surfels inside the mouth, which move with skull and jaw, if frames show it open and the head model has a space
    behind the lips."""
    hair_grows: bool = False
    """Whether hair and brows grow with the skin of a caricature; otherwise strands keep their length and width."""
    position_lr: float = option(0.03, unit="triangle units", ge=0, le=10)
    """Initial learning rate of positions."""
    rotation_lr: float = option(0.03, ge=0, le=10)
    """Initial learning rate of quaternions."""
    colour_lr: float = option(0.01, ge=0, le=10)
    """Initial learning rate of colour coefficients of degree 0."""
    harmonics_lr_factor: float = option(0.25, ge=0, le=100)
    """Learning rate of the other colour coefficients over `colour_lr`."""
    lr_decay: str = option("exponential", choices=("exponential", "cosine"))
    """How learning rates fall: log-linearly, or along half a period of the cosine (Loshchilov and Hutter 2017). The
    cosine is better for up to about 2000 steps and for noisy images, and worse where density control is on."""
    final_lr_factor: float = option(0.1, gt=0, le=1)
    """Ratio of last to first learning rate."""
    position_final_lr_factor: float = option(0.01, gt=0, le=1)
    """The same for positions."""
    distortion_weight: float = option(0.0, ge=0, le=1e6)
    """Weight of the depth distortion regularizer of 2DGS, from a quarter of the steps on."""
    normal_weight: float = option(0.0, ge=0, le=1e6)
    """Weight of the normal consistency regularizer of 2DGS, from a quarter of the steps on."""
    density: Density = field(default_factory=Density)
    refine_tracking: RefineTracking = field(default_factory=RefineTracking)
    edit: Edit = field(default_factory=Edit)
    backend: str = option("cpu", choices=("cpu", "torch", "cuda"))
    """`cpu`: Numba kernels. `torch`: the whole step in plain PyTorch, slow, on a GPU if torch finds one. `cuda`: the
    whole step on an NVIDIA GPU, with the rasterizer of gsplat. See docs/gpu.md."""

    def __post_init__(self) -> None:
        super().__post_init__()
        combine_mask_flags(self)


def budget_seconds(budget: str | None) -> float | None:
    """Read a budget.

    Args:
        budget: `Train.budget`.

    Returns:
        Seconds; None if there is no budget.
    """
    match = re.fullmatch(BUDGET, budget or "")
    return float(match[1]) * BUDGET_UNITS[match[2]] if match else None


def combine_mask_flags(train: Any) -> None:
    """Apply `add_mask_flags` and `remove_mask_flags` to `mask_flags`, in place, and empty them.

    Args:
        train: A `Train`, or the composed section.
    """
    kept = [flag for flag in train.mask_flags if flag not in train.remove_mask_flags]
    train.mask_flags = (*kept, *(flag for flag in train.add_mask_flags if flag not in kept))
    train.add_mask_flags = train.remove_mask_flags = ()
