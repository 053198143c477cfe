"""Settings of the training."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from carigs.settings.option import Section, option

DEFAULT_MASK_FLAGS = ("newly_visible", "occluded", "grazing", "outside_image", "outside_mesh", "hair", "mouth")
MASK_FLAGS = (*DEFAULT_MASK_FLAGS, "stretched", "lids", "brows", "ears", "eyeballs")
"""All flags of `carigs.gtstar.mask_flags.MaskFlag`."""


@dataclass
class Density(Section, key="train.density"):
    """Density control with binding inheritance (the strategy of GaussianAvatars)."""

    start: int = option(300, "First step that may clone, split and prune.", ge=0)
    stop: int = option(1500, "First step without density control.", ge=0)
    every: int = option(200, "Steps between two refinements (0: no density control).", ge=0)
    gradient_threshold: float = option(
        0.0002, "Mean screen-space positional gradient above which a surfel is cloned or split.", "NDC", ge=0
    )
    split_scale: float = option(
        0.01, "World scale above which a surfel is split instead of cloned.", "scene extents", ge=0
    )
    prune_opacity: float = option(0.005, "Opacity below which a surfel is removed.", ge=0, le=1)
    max_surfels: int = option(60000, "Budget of surfels.", ge=1)
    replace_fraction: float = option(
        0.2,
        "Fraction of the least important surfels that one refinement may replace once the budget is spent.",
        ge=0,
        le=1,
    )
    importance_views: int = option(8, "Training frames over which importance is measured.", ge=1)
    reset_every: int = option(0, "Steps between two opacity resets (0: none, which suits short trainings).", ge=0)


@dataclass
class RefineTracking(Section, key="train.refine_tracking"):
    """Refinement of the tracked head parameters on the real training frames by Adam."""

    enabled: bool = option(False, "Optimise pose and expression of the training frames along with the surfels.")
    translation_lr: float = option(2e-5, "Learning rate of the translation.", "metres", ge=0, lt=1)
    rotation_lr: float = option(2e-4, "Learning rate of head, neck, jaw and eye rotations.", "radians", ge=0, lt=1)
    expression_lr: float = option(1e-3, "Learning rate of the expression coefficients.", ge=0, lt=1)


@dataclass
class Train(Section, key="train"):
    """Optimisation of the surfels."""

    iterations: int = option(1500, "Optimisation steps, one image each.", ge=1)
    seed: int = option(0, "Seed of the order of images and of density control.", ge=0)
    threads: int = option(1, "Threads of the rasterizer; the result does not depend on it.", ge=1)
    gtstar_probability: float = option(
        0.5,
        "Probability that a step is supervised by a GT* frame: 0 uses real frames only, 1 GT* frames only.",
        ge=0,
        le=1,
    )
    num_gtstar_levels: int = option(
        1, "Number of levels with GT* frames, evenly spaced up to gamma (1: gamma alone).", ge=1, le=64
    )
    mask_flags: tuple[str, ...] = option(
        DEFAULT_MASK_FLAGS,
        "Flags whose pixels of GT* frames are left out of the loss. Surfels on triangles that always carry one of them"
        " are frozen in GT* steps.",
        choices=MASK_FLAGS,
    )
    add_mask_flags: tuple[str, ...] = option((), "Flags to add to `mask_flags`; empty afterwards.", choices=MASK_FLAGS)
    remove_mask_flags: tuple[str, ...] = option(
        (), "Flags to remove from `mask_flags`; empty afterwards.", choices=MASK_FLAGS
    )
    relight_surfels: bool = option(
        True, "Colours follow the light that was fitted for the GT* frames, if any (`gtstar.relight`)."
    )
    rig: str = option(
        "jbs",
        "`jbs`: Jacobian blend skinning. `jacobian`: the Jacobian of the own triangle alone.",
        choices=("jbs", "jacobian"),
    )
    sh_degree: int = option(0, "Degree of the spherical harmonics of view-dependent colour.", ge=0, le=3)
    rotate_harmonics: bool = option(True, "Spherical harmonics rotate with the head instead of staying in world axes.")
    surfels_per_face: int = option(1, "Initial surfels on each triangle.", ge=1)
    initial_scale: float = option(
        0.5,
        "Initial standard deviation of the discs, divided by the square root of `surfels_per_face`.",
        "triangle units",
        gt=0,
    )
    initial_opacity: float = option(0.3, "Initial opacity.", gt=0, lt=1)
    initial_colour_frames: int = option(32, "Training frames from which the initial colours are sampled.", ge=1)
    hair_regions: tuple[str, ...] = option(
        ("scalp",), "Regions of the head model with hair: `gtstar.hair_regions`, unless set here."
    )
    hair_layers: int = option(6, "Additional surfels on each hair triangle, spread along its normal.", ge=0)
    hair_length: float = option(0.012, "Height above the scalp over which they are spread.", "metres", ge=0, le=1)
    ssim_weight: float = option(0.2, "Weight w of the loss (1 - w) L1 + w (1 - SSIM).", ge=0, le=1)
    position_lr: float = option(0.03, "Initial learning rate of positions.", "triangle units", ge=0)
    scale_lr: float = option(0.017, "Initial learning rate of log scales.", ge=0)
    rotation_lr: float = option(0.03, "Initial learning rate of quaternions.", ge=0)
    opacity_lr: float = option(0.05, "Initial learning rate of opacity logits.", ge=0)
    colour_lr: float = option(0.01, "Initial learning rate of colour coefficients of degree 0.", ge=0)
    blend_lr: float = option(0.001, "Initial learning rate of the skinning weights of `jbs`.", ge=0)
    final_lr_factor: float = option(
        0.1, "Ratio of last to first learning rate; in between they fall log-linearly.", gt=0, le=1
    )
    position_final_lr_factor: float = option(0.01, "The same for positions.", gt=0, le=1)
    position_limit: float = option(
        1.0, "Distance from the triangle up to which a position is not penalised.", "triangle units", ge=0
    )
    position_weight: float = option(0.01, "Weight of the position regularizer.", ge=0)
    scale_limit: float = option(0.6, "Scale up to which a surfel is not penalised.", "triangle units", ge=0)
    scale_weight: float = option(1.0, "Weight of the scale regularizer.", ge=0)
    distortion_weight: float = option(0.0, "Weight of the depth distortion regularizer of 2DGS.", ge=0)
    normal_weight: float = option(0.0, "Weight of the normal consistency regularizer of 2DGS.", ge=0)
    regularize_from: int = option(500, "First step with the distortion and normal regularizers.", ge=0)
    density: Density = field(default_factory=Density)
    refine_tracking: RefineTracking = field(default_factory=RefineTracking)
    checkpoint_seconds: float = option(60.0, "Time between two checkpoints.", "seconds", ge=0)
    log_every: int = option(20, "Steps between two rows of the log.", ge=1)
    backend: str = option("cpu", "Rasterizer: `cpu`, or `cuda` through gsplat.", choices=("cpu", "cuda"))

    def __post_init__(self) -> None:
        super().__post_init__()
        combine_mask_flags(self)


def combine_mask_flags(train: Any) -> None:
    """Apply `add_mask_flags` and `remove_mask_flags` to `mask_flags`, in place, and empty them.

    Args:
        train: A `Train`, or the composed section.
    """
    kept = [flag for flag in train.mask_flags if flag not in train.remove_mask_flags]
    train.mask_flags = (*kept, *(flag for flag in train.add_mask_flags if flag not in kept))
    train.add_mask_flags = train.remove_mask_flags = ()
