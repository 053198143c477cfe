"""Settings of rendering and evaluation."""

from __future__ import annotations

from dataclasses import dataclass

from carigs.settings.option import Section, option


@dataclass
class Render(Section, key="render"):
    """Images of the trained avatar."""

    threads: int = option(1, "Threads of the rasterizer; the result does not depend on it.", ge=1)
    orbit_frames: int = option(24, "Frames of the novel camera orbit (0: no orbit).", ge=0)
    orbit_timestep: int | None = option(None, "Timestep shown on the orbit (null: the first test timestep).", ge=0)
    orbit_degrees: float = option(60.0, "Range of azimuth of the orbit.", "degrees", gt=0, le=360)
    backend: str = option("cpu", "Rasterizer: `cpu`, or `cuda` through gsplat.", choices=("cpu", "cuda"))


@dataclass
class Metrics(Section, key="metrics"):
    """Image and embedding metrics."""

    strict: bool = option(False, "Missing network weights are an error instead of an empty value with its reason.")
    weights: str | None = option(
        None, "Folder with network weights (null: the caches of the hub alone, which are always searched)."
    )
    download: bool = option(False, "Allow the libraries to download weights.")
    embeddings: tuple[str, ...] = option(("clip", "dino"), "Networks to evaluate.", choices=("clip", "dino"))
    crop: str = option(
        "pad_square",
        "Square input of the networks. `center`: central crop (the paper). `pad_square`: the whole image, padded.",
        choices=("center", "pad_square"),
    )
    source_prompt: str = option(
        "A realistic neutral head with natural lighting.", "Text of the unedited image (CLIP-D)."
    )
    edit_prompt: str = option(
        "A photorealistic caricature of a head with a highly exaggerated nose and large ears, under natural lighting.",
        "Text of the caricature (CLIP-I, CLIP-D).",
    )
    silhouette_band: int = option(2, "Half width of the silhouette region.", "pixels", ge=1)


@dataclass
class Tabulate(Section, key="tabulate"):
    """The comparison table."""

    reference: str = option("alternating", "Variant that the others are compared with, frame by frame.")
    digits: int = option(2, "Decimals of values in dB; scores between -1 and 1 have two more.", ge=0, le=15)
    resamples: int = option(2000, "Bootstrap resamples for each interval.", ge=1)
    confidence: float = option(0.95, "Confidence level of the intervals.", gt=0, lt=1)
    seed: int = option(0, "Seed of the bootstrap.", ge=0)


@dataclass
class Figures(Section, key="figures"):
    """The figures of the paper."""

    camera: int | None = option(None, "Camera shown in the strips (null: the validation camera).", ge=0)
    timestep: int | None = option(None, "Test timestep shown in the strips (null: the first).", ge=0)
    image_height: int = option(360, "Height of each image.", "pixels", ge=1)
    blend_error_samples: int = option(26, "Levels at which the blend error is evaluated.", ge=3)
