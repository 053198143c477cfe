"""The values of table 1 of the paper, for comparison with ours."""

from __future__ import annotations

SOURCE = "Matmon et al. 2026, CaricatureGS, arXiv 2601.03319, table 1"
"""Where the values are from."""
CAVEAT = (
    f"Published values: {SOURCE}; ten people of NeRSemble, 256 frames, no intervals. They compare with values of the "
    "same people, frames and networks alone (study=paper). The paper does not state which reading of CLIP-I and which "
    "layer of DINO it reports, nor the order of the frames of CLIP-C."
)
"""What a comparison with them must consider."""
PUBLISHED = {
    "SurFhead": {
        "clip_i_score_w2.5": "0.67",
        "clip_d": "0.0006",
        "clip_c_adjacent": "0.944",
        "dino_vitb8_cls": "0.757",
        "sd_score": "0.460",
    },
    "Ours": {
        "clip_i_score_w2.5": "0.73",
        "clip_d": "0.014",
        "clip_c_adjacent": "0.945",
        "dino_vitb8_cls": "0.888",
        "sd_score": "0.539",
    },
}
"""Values as printed, by method and metric of the catalogue."""
