"""Keys that earlier versions had: what replaces each, for the message to a user who still sets it."""

from __future__ import annotations

from collections.abc import Mapping

_THREADS = "threads are no setting; carigs run -- --set-threads {}=N, or `set-threads` of a profile"
_CONSTANT = "no setting any more; it is fixed at {}"
_REGIONS = "no setting any more; the head model names these regions {}"
_EYEBALLS, _LIDS = "left_eyeball and right_eyeball", "left_eyelid and right_eyelid"
_EARS, _MOUTH = "left_ear and right_ear", "lip_inside"

REMOVED: Mapping[str, str] = {
    "seed": "set for each training from its path; choose seeds by study.seeds",
    "train.seed": "set for each training from its path; choose seeds by study.seeds",
    "exaggerate.source": "no setting any more; exaggerate.file alone says that the caricature comes from a file",
    "exaggerate.path_error": "no setting any more; set the number of nodes by exaggerate.path_nodes",
    "exaggerate.cavity_stiffness": "no setting any more; exaggerate.limit_cavities=false switches it off",
    "render.levels": "made of study.levels and gamma; set these",
    "track.body": "set capture.body, which also holds for folders",
    "hair.regions": "one list for all stages; set regions.hair",
    "hair.eyeball_regions": _REGIONS.format(_EYEBALLS),
    "hair.mouth_regions": _REGIONS.format(_MOUTH),
    "hair.texture_limit": _CONSTANT.format("0.03"),
    "regions.mouth": _REGIONS.format(_MOUTH),
    "regions.eyeballs": _REGIONS.format(_EYEBALLS),
    "regions.lids": _REGIONS.format(_LIDS),
    "regions.ears": _REGIONS.format(_EARS),
    "gtstar.hair_regions": "one list for all stages; set regions.hair",
    "gtstar.mouth_regions": _REGIONS.format(_MOUTH),
    "gtstar.lid_regions": _REGIONS.format(_LIDS),
    "gtstar.ear_regions": _REGIONS.format(_EARS),
    "gtstar.eyeball_regions": _REGIONS.format(_EYEBALLS),
    "gtstar.registration_error_tolerance": _CONSTANT.format("a third of gtstar.registration_error_limit"),
    "train.hair_regions": "one list for all stages; set regions.hair",
    **{f"{stage}.threads": _THREADS.format(stage) for stage in ("hair", "gtstar", "train", "render", "metrics")},
    "gtstar.antialias": _CONSTANT.format("false"),
    "gtstar.depth_tolerance": _CONSTANT.format("0.003 metres"),
    "gtstar.grazing_cosine": _CONSTANT.format("0.1"),
    "gtstar.max_stretch": _CONSTANT.format("6"),
    "gtstar.hair_dilation": _CONSTANT.format("2 pixels"),
    "gtstar.background_margin": _CONSTANT.format("1 pixel"),
    "gtstar.relight_strength": _CONSTANT.format("0.85; gtstar.relight=none switches re-lighting off"),
    "gtstar.relight_limit": _CONSTANT.format("2"),
    "train.gtstar_fall": "no setting any more; train.gtstar_probability is the same in all steps",
    "train.device": "no setting any more; backend torch takes a GPU if torch finds one",
    "train.checkpoint_seconds": _CONSTANT.format("60 seconds"),
    "train.log_every": _CONSTANT.format("20 steps"),
    "train.initial_colour_frames": _CONSTANT.format("32"),
    "train.initial_hair_opacity": _CONSTANT.format("0.2"),
    "train.position_limit": _CONSTANT.format("1"),
    "train.scale_limit": _CONSTANT.format("0.6"),
    "train.position_weight": _CONSTANT.format("0.01"),
    "train.scale_weight": _CONSTANT.format("1"),
    "train.scale_lr": _CONSTANT.format("0.017"),
    "train.opacity_lr": _CONSTANT.format("0.05"),
    "train.blend_lr": _CONSTANT.format("0.001"),
    "train.density.split_scale": _CONSTANT.format("0.01"),
    "train.density.importance_views": _CONSTANT.format("8"),
    "train.plateau.frames": _CONSTANT.format("8"),
    "train.plateau.cooldown": _CONSTANT.format("0.25"),
    "train.plateau.min_gain": _CONSTANT.format("0.03 dB"),
    "train.refine_tracking.enabled": "no setting any more; set train.refine_tracking.until, such as to 0.5",
    "render.orbit_timestep": "no setting any more; the orbit shows the first test timestep",
    "render.orbit_degrees": _CONSTANT.format("60"),
    "metrics.silhouette_band": _CONSTANT.format("2 pixels"),
    "tabulate.resamples": _CONSTANT.format("2000"),
    "tabulate.confidence": _CONSTANT.format("0.95"),
    "tabulate.seed": _CONSTANT.format("0"),
    "html.fps": "no setting any more; it is fixed at 24, and carigs export takes --fps",
    "figures.image_height": _CONSTANT.format("360 pixels"),
    "figures.blend_error_samples": _CONSTANT.format("26"),
    "report.image_height": _CONSTANT.format("360 pixels"),
}
"""By key what replaces it. Fields that another key sets (`Option.set_by`) need no line."""
