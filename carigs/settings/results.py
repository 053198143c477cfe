"""Settings of rendering and evaluation."""

from __future__ import annotations

from dataclasses import dataclass

from carigs.settings.option import MAX_COUNT, Section, option, set_by


@dataclass
class Render(Section, key="render"):
    """Images of the trained avatar."""

    levels: tuple[float, ...] = set_by("study.levels", (0.0, 0.1, 0.15, 0.2, 0.25), ge=0, le=100)
    """Levels to render, in ascending order: 0, gamma, and the study's levels between them."""
    test_timesteps: int | None = option(None, ge=1, le=MAX_COUNT)
    """Timesteps of the test sequence that are rendered and measured, evenly spread (null: all)."""
    orbit_frames: int = option(24, ge=0, le=100_000)
    """Frames of the novel camera orbit (0: no orbit)."""
    backend: str = option("cpu", choices=("cpu", "torch", "cuda"))
    """Rasterizer: `cpu` (Numba), `torch` (plain PyTorch on the CPU, slow), or `cuda` (gsplat)."""


@dataclass
class TargetSheet(Section, key="target_sheet"):
    """A contact sheet of GT* targets."""


@dataclass
class Html(Section, key="html"):
    """The avatar as one HTML file."""


@dataclass
class Metrics(Section, key="metrics"):
    """Image and embedding metrics."""

    strict: bool = False
    """Missing network weights are an error instead of an empty value with its reason. A damaged file always is one."""
    weights: str | None = option(None, is_path=True)
    """Folder with network weights. Searched next: the folder in the environment variable CARIGS_WEIGHTS, the cache of
    the Hugging Face hub, and torch's."""
    embeddings: tuple[str, ...] = option(
        ("clip", "dino_vits16"), choices=("clip", "dino_vits16", "dino_vitb8", "dino_vitb8_patch_l11")
    )
    """Networks to evaluate. DINO ViT-B/8 is what DoesFS has, whom the paper follows; ViT-S/16 takes a small part of its
    time. Features of patches (`patch_l11`) take 1.2 MB of disk for each image."""
    lpips: tuple[str, ...] = option(("lpips_vgg", "lpips_alex"), choices=("lpips_vgg", "lpips_alex", "lpips_alex_3dgs"))
    """Variants of LPIPS against the true image. `lpips_alex_3dgs` gets images in [0, 1] where the network expects
    [-1, 1]: only for comparison with tables of papers that do so."""
    diffusion: tuple[str, ...] = option((), choices=("sd_1.5", "sd_2.1_base"))
    """Stable Diffusion models of the SD score: 40 passes of the network per frame, for a GPU."""
    identity: bool = False
    """Compare faces by dlib's face recognition network (the extra `identity`)."""
    crop: str = option("pad_square", choices=("center", "pad_square"))
    """Square input of the networks. `center`: central crop (the paper). `pad_square`: the whole image, padded."""
    source_prompt: str = "A realistic neutral head with natural lighting."
    """Text of the unedited image (CLIP-D)."""
    edit_prompt: str = (
        "A photorealistic caricature of a head with a highly exaggerated nose and large ears, under natural lighting."
    )
    """Text of the caricature (CLIP-I, CLIP-D)."""


@dataclass
class Tabulate(Section, key="tabulate"):
    """The comparison table."""

    reference: str = "alternating"
    """Variant that the others are compared with, frame by frame."""


@dataclass
class Figures(Section, key="figures"):
    """The figures of the paper."""

    camera: int | None = option(None, ge=0, le=MAX_COUNT)
    """Camera of the figures with one view (null: the validation camera, or the next to it that has a test frame)."""
    timestep: int | None = option(None, ge=0, le=MAX_COUNT)
    """Test timestep of the figures (null: the first that is rendered)."""


@dataclass
class Sweep(Section, key="sweep"):
    """The table and the figure of a sweep."""

    metrics: tuple[str, ...] = (
        "psnr", "ssim", "lpips_vgg", "clip_d", "identity_cos", "depth_error", "silhouette_iou", "photo_consistency_l1",
    )  # fmt: skip
    """Metrics of the figure and of the Markdown table, of all that docs/evaluation.md lists; those without a value are
    left out. The CSV file has all."""
    level: float | None = option(None, ge=0, le=100)
    """Level whose renderings are compared (null: gamma of each combination)."""


@dataclass
class Card(Section, key="card"):
    """The benchmark card."""

    machine: bool = True
    """Name processor, cores and memory of the machine. Its name and paths never appear."""


@dataclass
class Report(Section, key="report"):
    """The page with card, tables and figures."""
