"""The settings of every stage, one dataclass each: the only schema that the YAML of `conf/` is checked against."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

from carigs.errors import SettingsError


def one_of(default: str, *others: str) -> Any:
    """A field with these choices."""
    return field(default=default, metadata={"choices": (default, *others)})


def within(low: float, high: float, default: float) -> Any:
    """A field with these bounds, both included."""
    return field(default=default, metadata={"range": (low, high)})


def check(stage: str, settings: Any) -> None:
    """Raise `SettingsError` for a value of a stage's section that its field does not allow."""
    for f in fields(STAGES[stage]):
        value = getattr(settings, f.name)
        choices, bounds = f.metadata.get("choices"), f.metadata.get("range")
        if choices and value not in choices:
            known = f"{', '.join(choices[:-1])} or {choices[-1]}"
            raise SettingsError(f"{stage}.{f.name}={value} is unknown; choose {known}")
        if bounds and not bounds[0] <= value <= bounds[1]:
            raise SettingsError(f"{stage}.{f.name}={value} must lie in [{bounds[0]:g}, {bounds[1]:g}]")


@dataclass
class Toy:
    """The procedural subject (used when `capture.source` is `toy`)."""

    seed: int = 1
    """Which person: identity, skin, hair."""
    width: int = 208
    height: int = 272
    cameras: int = 9
    """On a frontal cap; the one nearest to the front is the validation view."""
    steps_per_sequence: int = 3
    """Frames in each of the ten sequences EMO-1..4, EXP-1..6."""
    supersampling: int = 3
    """Samples per pixel and axis."""
    texture_size: int = 768
    """The skin has the square of this many texels."""
    hair_strands: int = 6000
    """Hair strands on the scalp."""


@dataclass
class Capture:
    """What is reconstructed: the toy person, or a folder in the GaussianAvatars layout."""

    source: str = "toy"
    """`toy` or `folder`."""
    folder: str | None = None
    """The dataset, when `source` is `folder`."""
    head_model: str | None = None
    """Its head model (.npz, or FLAME's .pkl), when `source` is `folder`."""
    background: float = 1.0
    """Grey value that the images were composited on."""
    toy: Toy = field(default_factory=Toy)


@dataclass
class Exaggerate:
    """The caricature: the curvature-weighted Poisson equation, or a mesh from a file."""

    source: str = "poisson"
    """`poisson`, or `file`: a deformed mesh of the same topology becomes level gamma of a straight path."""
    file: str | None = None
    """An .npz with `delta` (V,3), or a mesh; `{gamma}` in it is replaced by the level it stands for."""
    gamma: float = 0.25
    """gamma_f, the exaggeration trained for."""
    curvature_floor: float = 0.3
    """eps in units of K_ref: |K|_eps = sqrt(K^2 + eps^2)."""
    relative_curvature: bool = True
    """Divide |K| by K_ref, so that the unit of the mesh does not matter."""
    curvature_smoothing: float = 0.005
    """Smoothing length of the curvature in units of the head's size, about its bounding box's diagonal (0: none)."""
    curvature_source: str = "subject"
    """Whose curvature exaggerates: `subject`; `ratio`: the subject's relative to the head model's mean face, so that
    only what is individual grows; `template`: the mean face's, one displacement for everyone (the paper)."""
    limit_cavities: bool = True
    """Ambient occlusion keeps nostrils, ear canals and the mouth bag from growing through the skin."""
    cavity_stiffness: float = 4.0
    """How much stiffer those are than the skin, which may not fold them (0: as stiff)."""
    gap_stiffness: float = 20.0
    """Stiffness of narrow gaps relative to the skin's: lips and lids grow outwards, not into each other (0: none)."""
    normalize_weights: bool = True
    """Divide the weights by their area mean: keeps the overall size."""
    rigid_components: bool = True
    """Small components (eyeballs) follow their surroundings by a similarity."""
    blendshape_transfer: str = "mixed"
    """What the caricature does to expressions: `offset` leaves them, `linear` exaggerates them as it does the head,
    `mixed` goes half of the way, so that lids close.  A caricature from a file leaves them."""
    path_error: float = 1e-4
    """Largest error of the path between its nodes, in diagonals of the bounding box: sets their number."""
    path_nodes: int = 0
    """Number of levels that the path is solved at (0: as `path_error` needs); 2 is the paper's linear blend."""
    region_constraint: str = "soft"
    """How the rest is held when one region is exaggerated: `soft`, `exact` or `literal`."""
    regions: dict[str, float] = field(default_factory=dict)
    """Levels that regions of the head model have where the rest has gamma, as {nose: 0.4, ears: 0}."""


@dataclass
class Gtstar:
    """GT*: every training frame warped to its caricature, and the reasons against its pixels."""

    threads: int = within(1, 10**4, 2)
    """Over timesteps; the result does not depend on it."""
    provider: str = one_of("lat", "identity", "precomputed")
    """`lat`: the local warp; `identity`: frames as they are; `precomputed`: edited frames from a folder."""
    folder: str | None = None
    """Edited frames, `{timestep:05d}_{camera:02d}.png` and, if they differ, mattes `..._mask.png`."""
    registration_error_limit: float = within(0, 1e9, 1.5)
    """Pixels by which a frame's colours may be off those of the other cameras on the same mesh."""
    registration_error_tolerance: float = within(0, 1e9, 0.5)
    """Pixels up to which a frame counts in full; from here its weight falls to 0 at `registration_error_limit`."""
    warp: str = one_of("perspective", "affine")
    """`perspective`: exact; `affine`: the paper's equation 5."""
    antialias: bool = False
    """Average over a pixel's footprint in the frame where triangles shrink."""
    supersampling: int = within(1, 8, 4)
    """Samples per pixel and axis that say how much of a pixel the mesh covers, along its outline in both images."""
    depth_tolerance: float = within(0, 1, 0.003)
    """Metres by which a pixel of the frame may lie before or behind the point that is looked for."""
    grazing_cosine: float = within(0, 1, 0.1)
    """Least cosine between view and normal in the frame, where the caricature is not seen just as obliquely."""
    max_stretch: float = within(1, 1e9, 6.0)
    """Largest ratio of a triangle's area in the caricature to its area in the frame."""
    relight: str = one_of("targets_and_surfels", "targets", "none")
    """`none`: targets keep the light of the natural surface, as in the paper; `targets`: they are shaded anew;
    `targets_and_surfels`: surfels too, whenever they are drawn."""
    relight_strength: float = within(0, 1, 0.85)
    """Power to which the ratio of new to old irradiance is taken."""
    relight_limit: float = within(1, 100, 2.0)
    """Largest factor, and its inverse the smallest, on linear colours."""
    hair_dilation: int = within(0, 1000, 2)
    """Width in pixels of the band around hair."""
    background_margin: int = within(0, 1000, 1)
    """Pixels left out around the mesh and the foreground where background is taken as known."""
    hair_regions: tuple[str, ...] = ("scalp",)
    """Head-model regions that carry hair; names that the model lacks are ignored, here and below."""
    mouth_regions: tuple[str, ...] = ("lip_inside",)
    """What belongs to the inside of the mouth, beside all that is seen between the lips."""
    lid_regions: tuple[str, ...] = ("left_eyelid", "right_eyelid")
    brow_regions: tuple[str, ...] = ("brows",)
    ear_regions: tuple[str, ...] = ("left_ear", "right_ear")
    eyeball_regions: tuple[str, ...] = ("left_eyeball", "right_eyeball")


@dataclass
class Density:
    """Density control with binding inheritance (GaussianAvatars' strategy)."""

    start: int = 300
    """First step that may refine."""
    stop: int = 1500
    """Steps from here on only move what there is."""
    every: int = 200
    """Steps between two refinements (0: none)."""
    gradient_threshold: float = 0.0002
    """Mean screen-space positional gradient (in NDC) above which a surfel is cloned or split."""
    split_scale: float = 0.01
    """World scale in scene extents above which a surfel is split rather than cloned."""
    prune_opacity: float = 0.005
    """Opacity below which a surfel is pruned."""
    max_surfels: int = 60000
    replace_fraction: float = 0.2
    """Share of the surfels that may be replaced at one refinement where the budget is spent: the least important."""
    importance_views: int = 8
    """Training frames by which importance is judged."""
    reset_every: int = 0
    """Steps between two resets of the opacities (0: none; they cost short trainings more than they give)."""


DEFAULT_MASK_FLAGS = ("newly_visible", "occluded", "grazing", "outside_image", "outside_mesh", "hair", "mouth")
"""What GT* frames are not trusted with.  Also known: stretched, lids, brows, ears, eyeballs."""


@dataclass
class RefineTracking:
    """Fine-tuning of the tracked head on the real training frames, by Adam; off where the tracking is exact."""

    enabled: bool = False
    translation_lr: float = 2e-5
    """Metres."""
    rotation_lr: float = 2e-4
    """Radians: head, neck, jaw and eyes."""
    expression_lr: float = 1e-3


@dataclass
class Train:
    """Optimisation of the surfels."""

    iterations: int = 1500
    seed: int = 0
    threads: int = 1
    gtstar_probability: float = 0.5
    """Probability p that a step is supervised by a GT* frame: 0 is real frames only, 1 is GT* only."""
    num_gtstar_levels: int = 1
    """Levels whose GT* frames supervise, equally often: gamma alone, or so many evenly up to it (4: its quarters)."""
    mask_flags: tuple[str, ...] = DEFAULT_MASK_FLAGS
    """Reasons for which pixels of GT* frames are left out; in those steps the surfels of triangles rest for which one
    of them always holds.
    """
    relight_surfels: bool = True
    """Colours follow the light that GT* frames were shaded with (`gtstar.relight`), where that was fitted."""
    rig: str = "jbs"
    """`jbs`: Jacobian blend skinning; `jacobian`: the own face's Jacobian alone."""
    sh_degree: int = 0
    """Of view-dependent colour, 0 to 3."""
    rotate_harmonics: bool = True
    """View-dependent colour turns with the head rather than staying with the world."""
    surfels_per_face: int = 1
    initial_scale: float = 0.5
    """Standard deviation of the first discs in triangle units; divided by the root of `surfels_per_face`."""
    initial_opacity: float = 0.3
    initial_colour_frames: int = 32
    """Training frames that the first colours are taken from."""
    hair_regions: tuple[str, ...] = ("scalp",)
    """Head-model regions whose faces carry hair."""
    hair_layers: int = 6
    """Extra surfels on each hair face, spread along the normal."""
    hair_length: float = 0.012
    """Metres above the scalp over which those are spread."""
    ssim_weight: float = 0.2
    position_lr: float = 0.03
    scale_lr: float = 0.017
    rotation_lr: float = 0.03
    opacity_lr: float = 0.05
    colour_lr: float = 0.01
    blend_lr: float = 0.001
    final_lr_factor: float = 0.1
    """What is left of the rates at the last step (they fall log-linearly)."""
    position_final_lr_factor: float = 0.01
    """The same for positions."""
    position_limit: float = 1.0
    """lambda_xyz's threshold in triangle units."""
    position_weight: float = 0.01
    scale_limit: float = 0.6
    scale_weight: float = 1.0
    distortion_weight: float = 0.0
    normal_weight: float = 0.0
    regularize_from: int = 500
    """First iteration with the distortion and normal terms."""
    density: Density = field(default_factory=Density)
    refine_tracking: RefineTracking = field(default_factory=RefineTracking)
    checkpoint_seconds: float = 60.0
    log_every: int = 20
    """Steps between two rows of the log."""
    backend: str = "cpu"
    """`cpu`, or `cuda` through gsplat."""


@dataclass
class Render:
    """Images of the trained avatar."""

    threads: int = 1
    orbit_frames: int = 24
    """Frames of the novel camera orbit (0: none)."""
    orbit_timestep: int | None = None
    """Expression shown on the orbit; the first test timestep if null."""
    orbit_degrees: float = 60.0
    """Width of the orbit in azimuth."""
    backend: str = "cpu"
    """`cpu`, or `cuda` through gsplat."""


@dataclass
class Truth:
    """The true caricature: rendered for the toy, a folder for a subject that brings one, else none."""

    folder: str | None = None
    """Folder with `frames.json`, `images/`, `fg_masks/`; `{level}` in it is replaced by the level."""


@dataclass
class Metrics:
    """Image and embedding metrics."""

    strict: bool = False
    """Make missing weights an error instead of a null with its reason."""
    weights: str | None = None
    """Folder with network weights; the hub's caches are searched too."""
    download: bool = False
    """Let the libraries fetch weights from the hub."""
    embeddings: tuple[str, ...] = ("clip", "dino")
    crop: str = "pad_square"
    """`center` as the paper, or `pad_square`: the whole portrait."""
    source_prompt: str = "A realistic neutral head with natural lighting."
    edit_prompt: str = (
        "A photorealistic caricature of a head with a highly exaggerated nose and large ears, under natural lighting."
    )
    silhouette_band: int = 2
    """Half width in pixels of the silhouette region."""


@dataclass
class Tabulate:
    """The comparison table."""

    reference: str = "alternating"
    """The variant that the others are compared with, frame by frame."""
    digits: int = 2
    """Decimals of values in dB; scores between -1 and 1 get two more."""
    resamples: int = 2000
    """Bootstrap resamples behind each interval."""
    confidence: float = 0.95
    seed: int = 0


@dataclass
class Figures:
    """The figures of the paper."""

    camera: int | None = None
    """View shown in the strips; the validation camera if null."""
    timestep: int | None = None
    """Frame of the held-out sequence shown in the strips; its first if null."""
    image_height: int = 360
    """Of each image in pixels."""
    blend_error_samples: int = 26
    """Levels at which the blend error is evaluated."""


@dataclass
class Study:
    """A set of subjects x variants x levels that makes one table."""

    name: str = "toy"
    subjects: tuple[str, ...] = ("toy",)
    variants: tuple[str, ...] = ("alternating", "surfhead", "surfhead_lit", "gtstar_only", "no_mask")
    levels: tuple[float, ...] = (0.0, 0.1, 0.15, 0.2, 0.25)


STAGES: dict[str, type] = {
    "capture": Capture,
    "exaggerate": Exaggerate,
    "gtstar": Gtstar,
    "train": Train,
    "render": Render,
    "truth": Truth,
    "metrics": Metrics,
    "tabulate": Tabulate,
    "figures": Figures,
}
