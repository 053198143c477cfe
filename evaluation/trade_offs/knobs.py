"""The settings whose trade-offs are shown, how their curves are read, and why a default may lie off the knee.

A reason is printed only where the measured default lies where the reason says.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import partial

import pandas as pd
from omegaconf import OmegaConf

from carigs.config import compose
from carigs.exaggeration.exaggerator import PATH_ERROR
from carigs.light.fitting import DIRECTIONS
from carigs.settings import Exaggerate, Gtstar
from evaluation.benchmarks.exaggeration.curvature_accuracy import heat_estimator
from evaluation.trade_offs.curve import ABOVE, BELOW, Choice, Curve, Knob, make_curve

TRAINED_BY_DEFAULT = "preset=balanced"
"""Case of the trainings with the defaults of the study `toy`."""
FLOAT32 = 1e-7
"""Relative resolution of the numbers in which a path is stored."""


def curvature(table: pd.DataFrame) -> list[Curve]:
    """Estimators of curvature on the finest mesh of each surface.

    Args:
        table: Records of `evaluation.benchmarks.surface`.

    Returns:
        A curve per surface.
    """
    errors, default = _chosen(table, r"error of K: (.*)"), heat_estimator(Exaggerate().curvature_smoothing)
    seconds, finest = _chosen(table, r"CPU: K: (.*)"), {}
    for case in dict.fromkeys(case for case, _ in errors):
        finest[case.rpartition(", ")[0]] = case  # meshes are in order of their fineness
    return [
        make_curve(
            case, [Choice(name, seconds[case, name], e) for (c, name), e in errors.items() if c == case], default
        )
        for case in finest.values()
    ]


def solvers(table: pd.DataFrame) -> list[Curve]:
    """Linear solvers on the smallest system.

    Args:
        table: Records of `evaluation.benchmarks.surface`.

    Returns:
        One curve.
    """
    residuals, seconds = _chosen(table, "(relative residual of one level)"), _chosen(table, "(one level)")
    cases = [case for case, _ in residuals]
    size = cases[0].partition(", ")[0]
    choices = [
        Choice(case.partition(", ")[2], seconds[case, "one level"], residual)
        for (case, _), residual in residuals.items()
        if case.startswith(f"{size}, ")
    ]
    return [make_curve(size, choices, choices[0].label, needed=FLOAT32)]  # the first is the one in use


def path_nodes(table: pd.DataFrame) -> list[Curve]:
    """Numbers of nodes of the path of the typical head: the one whose bounds of the blend error are measured.

    Args:
        table: Records of `evaluation.benchmarks.surface`.

    Returns:
        One curve.
    """
    head = next(case for case, _ in _chosen(table, "(rms error of the blend) at level .*")).rpartition(", ")[0]
    errors = _chosen(table, r"largest error of a path of (\d+) nodes")
    seconds = _chosen(table, r"CPU: solve a path of (\d+) nodes")
    default = _chosen(table, "(nodes of the default path)")[head, "nodes of the default path"]
    choices = [Choice(nodes, seconds[head, nodes], error) for (case, nodes), error in errors.items() if case == head]
    return [make_curve(head, choices, f"{default:g}", needed=PATH_ERROR)]


def supersampling(table: pd.DataFrame) -> list[Curve]:
    """Samples per pixel along outlines.

    Args:
        table: Records of `evaluation.benchmarks.target`.

    Returns:
        One curve.
    """
    settings = Gtstar()
    case = re.compile(rf"{settings.warp}, (\d)x\d")
    errors = _chosen(table, "(99th percentile of the error)")
    seconds = _chosen(table, "(visibility, warp and masks)")
    choices = [
        Choice(match[1], seconds[key[0], "visibility, warp and masks"] / 1e3, error)
        for key, error in errors.items()
        if (match := case.fullmatch(key[0]))
    ]
    return [make_curve("trusted pixels", choices, str(settings.supersampling))]


def light_directions(table: pd.DataFrame) -> list[Curve]:
    """Directions of the fitted light.

    Args:
        table: Records of `evaluation.benchmarks.target`.

    Returns:
        A curve per region.
    """
    fits, timesteps = _chosen(table, "(CPU: fit of the light)"), _chosen(table, "(CPU: transfers of a timestep)")
    seconds = {case: fit + timesteps[case, "CPU: transfers of a timestep"] for (case, _), fit in fits.items()}
    curves = []
    for region in ("skin", "face"):
        found = _chosen(table, f"(PSNR of trusted {region})")
        choices = [Choice(case.split()[0], seconds[case], psnr) for (case, _), psnr in found.items() if case in seconds]
        curves.append(make_curve(region, choices, str(DIRECTIONS), is_psnr=True))
    return curves


def trained(table: pd.DataFrame, pattern: str, default: str) -> list[Curve]:
    """Trainings with one setting changed.

    Args:
        table: Records of `evaluation.benchmarks.training_trade_offs`.
        pattern: What the cases match; its groups, joined by x, are the label.
        default: Label of the default.

    Returns:
        A curve for level 0 and one for the level of the training.
    """
    seconds, curves = {case: value for (case, _), value in _chosen(table, "(training)").items()}, []
    for level, name in (("0", "level 0"), ("gamma", "level γ")):
        choices = []
        for (case, _), psnr in _chosen(table, f"(PSNR at level {level}, head)").items():
            match = re.fullmatch(pattern, case)
            if match or case == TRAINED_BY_DEFAULT:
                choices.append(Choice("x".join(match.groups()) if match else default, seconds[case], psnr))
        curves.append(make_curve(name, choices, default, is_psnr=True))
    return curves


def _training_knob(setting: str, pattern: str = "", **texts: object) -> Knob:
    keys = setting.split(", ")
    toy = compose("study=toy")
    default = "x".join(f"{OmegaConf.select(toy, key):g}" for key in keys)
    pattern = pattern or rf"{re.escape(setting)}=([\d.e-]+)"
    curves = partial(trained, pattern=pattern, default=default)
    return Knob("train", setting, "training", "training, CPU s", "PSNR of the head, dB", curves, **texts)


def knobs() -> Iterator[Knob]:
    """All settings that are shown, in the order of the stages.

    Yields:
        The settings.
    """
    yield Knob(
        "exaggerate", "exaggerate.curvature_smoothing", "surface", "estimate of K, CPU s", "relative rms error of K",
        curvature,
        "Estimators of Gaussian curvature where it is known. The default is the angle defect after a heat step.",
        {
            ABOVE: "The heat step costs a factorisation and is meant for noise: without it, single vertices of a "
            "tracked mesh get weights of their own. The whole estimate is a small part of the set-up.",
            BELOW: "Angle defects sum to 2 pi times the Euler characteristic on every mesh (Gauss-Bonnet); estimates "
            "by a quadric do not, and take longer.",
        },
    )  # fmt: skip
    yield Knob(
        "exaggerate", "linear solver", "surface", "factorisation and one level, CPU s", "relative residual", solvers,
        f"Residuals below {FLOAT32:g} count as equal: a path is stored in float32.",
        {
            ABOVE: "The default suits several levels and large meshes (exaggeration.md); on one level of this mesh the "
            "direct solvers differ by hundredths of a second.",
        },
    )  # fmt: skip
    yield Knob(
        "exaggerate", "exaggerate.path_nodes", "surface", "solving the path, CPU s", "largest error, diagonals",
        path_nodes,
        f"Errors below {PATH_ERROR:g}, which the default is chosen for, count as equal. Two nodes are the paper's "
        "linear blend.",
    )  # fmt: skip
    yield Knob(
        "gtstar", "gtstar.supersampling", "target", "one target of 802x550, CPU s", "99th percentile of the error",
        supersampling,
        "Samples per pixel along each axis on the outline of the mesh.",
        {
            ABOVE: "The error is over all trusted pixels; supersampling changes only those on the outline, which the "
            "region `silhouette` measures.",
        },
    )  # fmt: skip
    yield Knob(
        "gtstar", "light directions", "target", "fit and transfers of a timestep, CPU s", "PSNR of relit pixels, dB",
        light_directions,
        "Directions of the light that is fitted to the skin (`carigs/light/fitting.py`).",
        {
            ABOVE: "The light of the toy has few sources. The number for captures under many lamps was not measured.",
            BELOW: "Each timestep pays for the directions in the targets and again at every rendering of a new pose.",
        },
    )  # fmt: skip
    yield _training_knob(
        "train.iterations",
        r"train\.iterations=(\d+) train\.density\.stop=\d+",
        note="Steps; density control ends after two thirds of them.",
        reasons={
            BELOW: "The study `toy` is a demonstration that must end within a quarter of an hour on two cores. "
            "`preset=best` doubles the steps; studies of real captures set their own number.",
            ABOVE: "`preset=fast` halves the steps.",
        },
    )
    yield _training_knob(
        "train.sh_degree",
        reasons={
            BELOW: "Degree 0 stores one coefficient per channel instead of 4, 9 or 16, and colours that do not depend "
            "on the view cannot fit the view of one frame. Studies of people set 2 (`study=ict`, `study=own`).",
        },
    )
    more = "The number of surfels is the size of the avatar's file and the time of a frame in a viewer, too."
    yield _training_knob("train.surfels_per_face", reasons={BELOW: more})
    yield _training_knob(
        "train.density.gradient_threshold",
        note="The lower the threshold, the more surfels are cloned and split.",
        reasons={BELOW: more, ABOVE: "The default is the published threshold (3DGS, SurFhead)."},
    )
    yield _training_knob(
        "capture.toy.width, capture.toy.height",
        r"capture\.toy\.width=(\d+) capture\.toy\.height=(\d+)",
        note="Size of the training images in pixels; all avatars are rendered and compared at the default size.",
        reasons={
            BELOW: "The size of training images is the dataset's. The toy's are small so that the study is short.",
            ABOVE: "The size of training images is the dataset's; frames are not reduced.",
        },
    )


def _chosen(table: pd.DataFrame, pattern: str) -> dict[tuple[str, str], float]:
    """Values of the quantities that match, by case and the pattern's group, in the order of the records."""
    label = table["quantity"].str.extract(f"^{pattern}$")[0]
    found = table[label.notna()]
    return dict(zip(zip(found["case"], label[label.notna()], strict=True), found["value"], strict=True))
