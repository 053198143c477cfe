"""Every metric by its name in the records: how tables title it, which values are better, and where it comes from."""

from __future__ import annotations

from typing import Literal, NamedTuple


class Metric(NamedTuple):
    """What a reader of a table must know of a metric.

    Attributes:
        title: Heading of its column.
        better: Which values are better; `neither` if a value cannot be ranked without another one.
        digits: Digits after the decimal point in tables.
        unit: Unit of the values; empty for pure numbers.
        source: Definition or publication.
    """

    title: str
    better: Literal["higher", "lower", "neither"]
    digits: int
    unit: str
    source: str


ORDER = "the orbit by azimuth beside level 0, test frames of a camera by timestep beside the capture"
"""Which frames CLIP-C compares."""
CATALOGUE = {
    "psnr": Metric("PSNR", "higher", 2, "dB", "-10 log10(mean squared error), mean over frames"),
    "ssim": Metric("SSIM", "higher", 4, "", "Wang et al. 2004, window 11 x 11, zero-padded"),
    "depth_error": Metric("Depth error", "lower", 2, "mm", "mean |depth of the surfels - depth of the mesh|"),
    "normal_error": Metric("Normal error", "lower", 1, "degrees", "mean angle between surfels' normal and mesh normal"),
    "silhouette_iou": Metric("Silhouette IoU", "higher", 4, "", "opacity above 0.5 against the mesh"),
    "hole_rate": Metric("Holes", "lower", 4, "", "mean of 1 - opacity on the mesh, of surfels it does not hide"),
    "exaggeration_gain": Metric(
        "Gain", "neither", 3, "", "least-squares factor from the mesh's displacement to the surfels'; 1 is exact"
    ),
    "photo_consistency_l1": Metric(
        "Photo-consistency",
        "lower",
        4,
        "",
        "mean |difference| to the nearest camera's frame, warped by mesh depth",
    ),
    "photo_consistency_l1_truth": Metric(
        "Photo-consistency of the truth", "neither", 4, "", "the same of the true images: the floor for a renderer"
    ),
    "flicker_l1": Metric("Flicker", "lower", 4, "", "mean |difference| to the next frame, warped by mesh depth"),
    "sharpness": Metric("Sharpness", "neither", 3, "", "gradient energy over that of the true image; 1 is exact"),
    "sharpness_to_frame": Metric(
        "Sharpness to frame",
        "neither",
        3,
        "",
        "gradient energy over that of the frame, where there is no truth",
    ),
    "clip_i_cos": Metric("CLIP-I", "higher", 4, "", "cosine of frame and edit prompt"),
    "clip_i_score_w2.5": Metric("CLIP-I (2.5 x)", "higher", 4, "", "CLIPScore, Hessel et al. 2021"),
    "clip_i_image": Metric("CLIP-I (images)", "neither", 4, "", "cosine of frame and original, Ruiz et al. 2023"),
    "clip_d": Metric("CLIP-D", "higher", 4, "", "directional similarity, Gal et al. 2021"),
    "clip_c_adjacent": Metric("CLIP-C", "higher", 4, "", f"cosine of adjacent frames; {ORDER}"),
    "clip_c_unedited": Metric("CLIP-C (unedited)", "neither", 4, "", f"CLIP-C of the unedited frames; {ORDER}"),
    "clip_c_dir_edit": Metric("CLIP-C (edit)", "higher", 4, "", f"cosine of the edits of adjacent frames; {ORDER}"),
    "clip_c_dir_motion": Metric(
        "CLIP-C (motion)", "higher", 4, "", f"cosine of the changes from frame to frame, edited and not; {ORDER}"
    ),
    "dino_vits16_cls": Metric(
        "DINO S/16", "neither", 4, "", "Caron et al. 2021, ViT-S/16, class token, against the frame"
    ),
    "dino_vitb8_cls": Metric("DINO", "neither", 4, "", "Caron et al. 2021, ViT-B/8, class token, against the frame"),
    "dino_vitb8_patch_l11": Metric(
        "DINO (patches)", "neither", 4, "", "as DINO, mean over patches of the output of layer 11, against the frame"
    ),
}
"""In the order of the tables. DINO and CLIP-I (images) are 1 for an avatar that does nothing."""
