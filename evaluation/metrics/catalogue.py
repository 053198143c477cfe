"""Every metric by its name in the records: how tables title it, which values are better, and where it comes from."""

from __future__ import annotations

from evaluation.tables.metric import Catalogue, Metric

ORDER = "the orbit by azimuth beside level 0, test frames of a camera by timestep beside the capture"
"""Which frames CLIP-C compares."""
CATALOGUE: Catalogue = {
    "clip_i_score_w2.5": Metric(
        "CLIP-I", "higher", 4, "", "CLIPScore, 2.5 max(cosine of frame and edit prompt, 0), Hessel et al. 2021", "paper"
    ),
    "clip_d": Metric("CLIP-D", "higher", 4, "", "directional similarity, Gal et al. 2021", "paper"),
    "clip_c_adjacent": Metric("CLIP-C", "higher", 4, "", f"cosine of adjacent frames; {ORDER}", "paper", "orbit"),
    "dino_vitb8_cls": Metric(
        "DINO", "neither", 4, "", "Caron et al. 2021, ViT-B/8, class token, against the frame", "paper"
    ),
    "sd_1.5": Metric(
        "SD",
        "neither",
        4,
        "",
        "equation 10, Stable Diffusion 1.5, empty prompt, t = round(linspace(20, 980, 10)), seeds 0 to 3, latents "
        "scaled by 0.18215; blur raises it: read it with the sharpness",
        "paper",
    ),
    "sd_2.1_base": Metric("SD (2.1 base)", "neither", 4, "", "as sd_1.5 with Stable Diffusion 2.1 base", "readings"),
    "clip_i_cos": Metric("CLIP-I, cosine", "higher", 4, "", "cosine of frame and edit prompt", "readings"),
    "clip_i_image": Metric(
        "CLIP-I, images", "neither", 4, "", "cosine of frame and original, Ruiz et al. 2023", "readings"
    ),
    "clip_c_unedited": Metric(
        "CLIP-C, unedited", "neither", 4, "", f"CLIP-C of the unedited frames; {ORDER}", "readings", "orbit"
    ),
    "clip_c_dir_edit": Metric(
        "CLIP-C, edit", "higher", 4, "", f"cosine of the edits of adjacent frames; {ORDER}", "readings", "orbit"
    ),
    "clip_c_dir_motion": Metric(
        "CLIP-C, motion",
        "higher",
        4,
        "",
        f"cosine of the changes from frame to frame, edited and not; {ORDER}",
        "readings",
        "orbit",
    ),
    "dino_vits16_cls": Metric(
        "DINO S/16", "neither", 4, "", "Caron et al. 2021, ViT-S/16, class token, against the frame", "readings"
    ),
    "dino_vitb8_patch_l11": Metric(
        "DINO, patches",
        "neither",
        4,
        "",
        "as DINO, mean over patches of the output of layer 11, against the frame",
        "readings",
    ),
    "psnr": Metric("PSNR", "higher", 2, "dB", "-10 log10(mean squared error), mean over frames", "truth"),
    "ssim": Metric("SSIM", "higher", 4, "", "Wang et al. 2004, window 11 x 11, zero-padded", "truth"),
    "lpips_vgg": Metric("LPIPS (VGG)", "lower", 4, "", "Zhang et al. 2018, VGG16, images in [-1, 1]", "truth"),
    "lpips_alex": Metric("LPIPS (AlexNet)", "lower", 4, "", "Zhang et al. 2018, AlexNet, images in [-1, 1]", "truth"),
    "lpips_alex_3dgs": Metric(
        "LPIPS (AlexNet, [0, 1])",
        "lower",
        4,
        "",
        "AlexNet, fed with [0, 1] where it expects [-1, 1], as in code after 3D Gaussian Splatting; not comparable",
        "truth",
    ),
    "depth_error": Metric(
        "Depth error", "lower", 2, "mm", "mean |depth of the surfels - depth of the mesh|", "geometry"
    ),
    "normal_error": Metric(
        "Normal error", "lower", 1, "degrees", "mean angle between surfels' normal and mesh normal", "geometry"
    ),
    "silhouette_iou": Metric("Silhouette IoU", "higher", 4, "", "opacity above 0.5 against the mesh", "geometry"),
    "hole_rate": Metric(
        "Holes", "lower", 4, "", "mean of 1 - opacity on the mesh, of surfels it does not hide", "geometry"
    ),
    "exaggeration_gain": Metric(
        "Gain",
        "neither",
        3,
        "",
        "least-squares factor from the mesh's displacement to the surfels'; 1 is exact",
        "geometry",
    ),
    "photo_consistency_l1": Metric(
        "Photo-consistency", "lower", 4, "", "mean |difference| to the nearest camera's frame, warped by mesh depth"
    ),
    "photo_consistency_l1_truth": Metric(
        "Photo-consistency of the truth", "neither", 4, "", "the same of the true images: the floor for a renderer"
    ),
    "flicker_l1": Metric(
        "Flicker", "lower", 4, "", "mean |difference| to the next frame, warped by mesh depth", protocol="orbit"
    ),
    "sharpness": Metric("Sharpness", "neither", 3, "", "gradient energy over that of the true image; 1 is exact"),
    "sharpness_to_frame": Metric(
        "Sharpness to frame", "neither", 3, "", "gradient energy over that of the frame, where there is no truth"
    ),
    "identity_cos": Metric(
        "identity", "higher", 4, "", "cosine of face embeddings (dlib) to the mean of the real frames", "identity"
    ),
    "identity_distance": Metric(
        "identity, distance",
        "lower",
        3,
        "",
        "Euclidean distance of face embeddings (dlib) to the mean of the real frames; the same person: below 0.6",
        "identity",
    ),
}
"""In the order of the columns. DINO and CLIP-I of images are 1 for an avatar that does nothing."""
