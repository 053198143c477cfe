"""Every metric by its name in the records: how tables title it, which values are better, and where it comes from."""

from __future__ import annotations

from evaluation.tables.metric import Catalogue, Metric

CATALOGUE: Catalogue = {
    "clip_i_score_w2.5": Metric(
        "CLIP-I", "higher", 4, "", "CLIPScore, 2.5 max(cosine of frame and edit prompt, 0), Hessel et al. 2021", "paper"
    ),
    "clip_d": Metric("CLIP-D", "higher", 4, "", "directional similarity, Gal et al. 2021", "paper"),
    "clip_c_adjacent": Metric("CLIP-C", "higher", 4, "", "cosine of adjacent frames of the orbit", "paper", "orbit"),
    "dino_vitb8_cls": Metric(
        "DINO", "neither", 4, "", "Caron et al. 2021, ViT-B/8, class token, against the frame", "paper"
    ),
    "clip_i_cos": Metric("CLIP-I, cosine", "higher", 4, "", "cosine of frame and edit prompt", "readings"),
    "psnr": Metric("PSNR", "higher", 2, "dB", "-10 log10(mean squared error), mean over frames", "truth"),
    "ssim": Metric("SSIM", "higher", 4, "", "Wang et al. 2004, window 11 x 11, zero-padded", "truth"),
}
"""In the order of the columns. DINO against the unedited frame is 1 for an avatar that does nothing."""
