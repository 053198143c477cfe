"""Metrics of images, regions and embeddings, and bootstrap intervals, where formulas divide by zero or cancel.

Example:
    PYTHONPATH=tests python -m stress.metrics results/stress/metrics.csv
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import combinations_with_replacement, product
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Float64
from scipy.signal import convolve2d

from carigs.capture import Camera
from carigs.raster import rasterize_mesh
from evaluation.command_line import run
from evaluation.metrics.image_quality import psnr, region_mean, squared_error, ssim_map
from evaluation.metrics.networks.clip import clip_c_adjacent, clip_d, clip_i, clip_i_score
from evaluation.metrics.networks.dino import dino_similarity
from evaluation.metrics.regions import image_regions, surface_regions
from evaluation.tables.bootstrap import mean_interval
from evaluation.tables.metric_records import MetricRecord, StudyPoint, metric_record
from evaluation.tables.summary import read_metrics
from stress.case import Case, Measure, difference, run_suite, violations
from stress.meshes import ball, camera_at
from stress.targets import bald_model

Image = Float64[np.ndarray, "h w 3"]
SIZES = ((1, 1), (1, 12), (12, 1), (5, 5), (11, 11), (23, 31))
IMAGES: dict[str, Callable[[tuple[int, int]], Image]] = {
    "black": lambda size: np.zeros((*size, 3)),
    "white": lambda size: np.ones((*size, 3)),
    "grey": lambda size: np.full((*size, 3), 0.3),
    "grey and 1e-9": lambda size: np.full((*size, 3), 0.3 + 1e-9),
    "noise": lambda size: np.random.default_rng(0).random((*size, 3)),
    "noise but one pixel": lambda size: _with_a_white_pixel(np.random.default_rng(0).random((*size, 3))),
}


def cases() -> Iterator[Case]:
    """All cases.

    Yields:
        Cases.
    """
    for size, (first, second) in product(SIZES, combinations_with_replacement(IMAGES, 2)):
        pair = IMAGES[first](size), IMAGES[second](size)
        yield Case(f"{first} and {second}, {size[1]} x {size[0]}", partial(pair_of_images, *pair))
    for size, region in product(SIZES, ("nothing", "one pixel", "everything")):
        yield Case(f"region of {region}, {size[1]} x {size[0]}", partial(region_of_images, size, region))
    for (view, camera), foreground in product(VIEWS.items(), ("nothing", "everything", "the mesh")):
        yield Case(f"regions of a head {view}, foreground of {foreground}", partial(head_regions, camera, foreground))
    yield Case("regions of a head model that are empty", empty_regions)
    for count, (values, make), factors in product((2, 3, 12, 200), VALUES.items(), (1, 2)):
        name = f"interval of {count} values, {values}, {factors} factors"
        yield Case(name, partial(interval, make(count), factors))
    for (values, make), confidence in product(VALUES.items(), (0.5, 0.999)):
        yield Case(f"interval with confidence {confidence}, {values}", partial(interval, make(30), 1, confidence))
    for factors in (1, 2, 3):
        yield Case(f"interval of one value, {factors} factors", partial(single_value, factors))
    yield Case("interval of 100 000 values", partial(many_values, 100_000))
    for dimension, relation in product((1, 2, 512), RELATIONS):
        yield Case(f"{relation} embeddings of {dimension} numbers", partial(embeddings, dimension, relation))
    for value in (0.0, 1e-300, 1e300, np.inf, -np.inf, np.nan, None):
        yield Case(f"record of the value {value}", partial(record, value))
    for name, text in BROKEN_RECORDS.items():
        yield Case(f"records: {name}", partial(read_records, text), invalid=True)


def _with_a_white_pixel(image: Image) -> Image:
    image[image.shape[0] // 2, image.shape[1] // 2] = 1.0
    return image


def ssim_by_convolution(image: Image, truth: Image) -> Float64[np.ndarray, "h w"]:
    """SSIM of Wang et al. 2004 by dense convolution, zero-padded.

    Variances are sums of squared differences from the mean, which do not cancel: sum w (x - m)^2, and where the window
    reaches over the border, its pixels are zeros.

    Args:
        image: Image.
        truth: True image.

    Returns:
        Mean of the channels at every pixel.
    """
    offsets = np.arange(-5, 6)
    window = np.exp(-(offsets[:, None] ** 2 + offsets**2) / (2 * 1.5**2))
    window /= window.sum()
    total = np.zeros(image.shape[:2])
    for x, y in zip(image.transpose(2, 0, 1), truth.transpose(2, 0, 1), strict=True):
        mx, my = (convolve2d(channel, window, mode="same") for channel in (x, y))
        vx, vy, cov = np.zeros_like(mx), np.zeros_like(mx), np.zeros_like(mx)
        px, py = np.pad(x, 5), np.pad(y, 5)
        for (j, i), w in np.ndenumerate(window):
            dx, dy = (p[j : j + x.shape[0], i : i + x.shape[1]] - m for p, m in ((px, mx), (py, my)))
            vx, vy, cov = vx + w * dx * dx, vy + w * dy * dy, cov + w * dx * dy
        total += (2 * mx * my + 1e-4) * (2 * cov + 9e-4) / ((mx**2 + my**2 + 1e-4) * (vx + vy + 9e-4)) / 3
    return total


def pair_of_images(image: Image, truth: Image) -> Iterator[Measure]:
    """PSNR and SSIM of two images.

    Args:
        image: Image.
        truth: True image.

    Yields:
        Differences from closed forms and from a dense convolution, from symmetry, and values out of range.
    """
    mean = math.fsum(((image - truth) ** 2).ravel()) / image.size
    expected = math.inf if mean == 0 else -10 * math.log10(mean)
    yield difference("PSNR, dB", psnr(image, truth), expected, 1e-9)
    yield difference(
        "PSNR of single precision, dB",
        psnr(np.float32(image), np.float32(truth)),
        expected,
        1e-4 if mean > 1e-12 else np.inf,
    )
    similarity = ssim_map(image, truth)
    yield difference("SSIM", similarity, ssim_by_convolution(image, truth), 1e-11)
    yield difference("SSIM with exchanged images", similarity, ssim_map(truth, image), 1e-12)
    yield violations("SSIM beyond [-1, 1]", ~((similarity >= -1) & (similarity <= 1 + 1e-12)))
    if (image == truth).all():
        yield difference("SSIM of equal images", similarity, 1.0, 0.0)
    same = ssim_map(image, image)
    yield difference("SSIM of an image with itself", same, 1.0, 0.0)


def region_of_images(size: tuple[int, int], region: str) -> Iterator[Measure]:
    """Metrics of a region: undefined without pixels, otherwise those of its pixels.

    Args:
        size: Rows and columns.
        region: Which pixels.

    Yields:
        Differences.
    """
    image, truth = IMAGES["noise"](size), IMAGES["grey"](size)
    inside = np.full(size, region == "everything")
    if region == "one pixel":
        inside[-1, 0] = True
    similarity, errors = ssim_map(image, truth), squared_error(image, truth)
    if region == "nothing":
        yield violations("defined values", ~np.isnan([psnr(image, truth, inside), region_mean(similarity, inside)]))
        return
    expected = -10 * math.log10(math.fsum(errors[inside].ravel()) / errors[inside].size)
    yield difference("PSNR, dB", psnr(image, truth, inside), expected, 1e-9)
    mean = math.fsum(similarity[inside]) / inside.sum()
    yield difference("SSIM", region_mean(similarity, inside), mean, 1e-12)


VIEWS = {
    "from afar": camera_at(1.0, (32, 24), 60.0),
    "from within": camera_at(0.0, (32, 24), 20.0),
    "behind the camera": camera_at(-1.0, (32, 24), 60.0),
    "in one pixel": camera_at(1.0, (1, 1), 2.0),
    "in one row": camera_at(1.0, (40, 1), 60.0),
}


def head_regions(camera: Camera, foreground: str) -> Iterator[Measure]:
    """Regions of a frame contain and exclude each other as defined, whatever is in view.

    Args:
        camera: The camera.
        foreground: What the matte shows.

    Yields:
        Pixels in which they do not.
    """
    vertices, faces = ball(2, 0.15)
    x, y, z = vertices.T
    parts = {
        "scalp": y > 0.1, "face": (z < -0.05) & (y < 0.1), "neck": y < -0.12, "lips": (z < -0.1) & (np.abs(y) < 0.04),
        "left_ear": x > 0.13, "right_ear": x < -0.13, "left_eyeball": (z < -0.05) & (y > 0.04) & (x > 0.02),
        "right_eyeball": (z < -0.05) & (y > 0.04) & (x < -0.02), "brows": (z < -0.05) & (y > 0.08),
    }  # fmt: skip
    model = replace(bald_model((vertices, faces)), regions={name: np.flatnonzero(p) for name, p in parts.items()})
    fragments = rasterize_mesh(vertices, faces, camera)
    mesh = fragments.face >= 0
    matte = {"nothing": np.zeros_like(mesh), "everything": np.ones_like(mesh), "the mesh": mesh}[foreground]
    regions = image_regions(surface_regions(model, vertices), vertices, fragments, camera, matte, band=2)
    yield violations("pixels not in the whole image", ~regions["full"])
    yield violations("pixels of the head", regions["head"] != (matte | mesh))
    for name in ("face", "eyes", "brow", "neck_ear", "skin"):
        yield violations(f"pixels of {name} off the mesh", regions[name] & ~mesh)
    yield violations("pixels of hair in the silhouette", regions["silhouette"] & regions["hair"])
    yield violations("pixels of hair off head and mesh", regions["hair"] & ~regions["head"])
    yield violations("pixels of the mouth in the skin", regions["skin"] & regions["mouth"])
    yield violations("silhouette without an outline", regions["silhouette"] & (mesh.all() | ~mesh.any()))
    yield from _regions_have_values(regions, mesh.shape)


def empty_regions() -> Iterator[Measure]:
    """A head model whose regions have no vertex: regions without pixels, but for those of the whole mesh.

    Yields:
        Pixels.
    """
    vertices, faces = ball(2, 0.15)
    names = ("scalp", "face", "neck", "lips", "left_ear", "right_ear", "left_eyeball", "right_eyeball", "brows")
    model = replace(bald_model((vertices, faces)), regions={name: np.zeros(0, int) for name in names})
    fragments = rasterize_mesh(vertices, faces, VIEWS["from afar"])
    mesh = fragments.face >= 0
    surface = surface_regions(model, vertices)
    regions = image_regions(surface, vertices, fragments, VIEWS["from afar"], mesh, band=2)
    for name in ("hair", "face", "mouth", "eyes", "brow", "neck_ear"):
        yield violations(f"pixels of {name}", regions[name])
    yield violations("pixels of the skin", regions["skin"] != mesh)


def _regions_have_values(regions: dict[str, Bool[np.ndarray, "h w"]], size: tuple[int, int]) -> Iterator[Measure]:
    """A region has a PSNR if and only if it has a pixel."""
    image, truth = IMAGES["white"](size), IMAGES["grey"](size)
    for name, region in regions.items():
        expected = -20 * math.log10(0.7) if region.any() else math.nan
        found = psnr(image, truth, region)
        yield Measure(
            f"PSNR of {name}", 0.0 if math.isnan(expected) and math.isnan(found) else abs(found - expected), 1e-9
        )


VALUES: dict[str, Callable[[int], Float64[np.ndarray, " n"]]] = {
    "zeros": np.zeros,
    "equal": lambda n: np.full(n, 0.1),
    "equal and huge": lambda n: np.full(n, 1e150),
    "equal and tiny": lambda n: np.full(n, 1e-150),
    "normal": lambda n: np.random.default_rng(n).normal(size=n),
    "far from zero": lambda n: 1e9 + np.random.default_rng(n).normal(size=n),
    "one outlier": lambda n: np.append(np.zeros(n - 1), 1e6),
}
OPTIONS = {"resamples": 300, "seed": 3}


def _factors(count: int, number: int) -> list[list[int]]:
    """Labels of `number` crossed factors."""
    side = math.ceil(count ** (1 / number))
    return [(np.arange(count) // side**k % side).tolist() for k in range(number)]


def interval(values: Float[np.ndarray, " n"], number: int, confidence: float = 0.95) -> Iterator[Measure]:
    """Bootstrap interval of values.

    Args:
        values: The values.
        number: Number of crossed factors.
        confidence: Coverage of the interval.

    Yields:
        Differences from the mean, from the value that all share, and from the intervals of moved, scaled and shuffled
        values; all relative to the size of the values.
    """
    factors, size = _factors(len(values), number), max(float(np.abs(values).max()), 1e-300)
    found = mean_interval(values, factors, confidence=confidence, **OPTIONS)
    mean, low, high = (number / size for number in found)
    yield difference("mean", mean, math.fsum(values / size) / len(values), 1e-14)
    spread = float(np.ptp(values)) / size
    yield violations("ends that are not numbers", ~np.isfinite([low, high]))
    yield Measure("low above high", low - high, 0.0)
    if spread == 0:
        yield difference("ends, all values equal", [low, high], mean, 1e-12)
    scaled = mean_interval(-0.5 * values, factors, confidence=confidence, **OPTIONS)
    yield difference("interval of values times -0.5", -2 * np.array(scaled)[[0, 2, 1]] / size, [mean, low, high], 1e-9)
    order = np.random.default_rng(0).permutation(len(values))
    labels = [np.array(factor)[order].tolist() for factor in factors]
    shuffled = mean_interval(values[order], labels, confidence=confidence, **OPTIONS)
    yield difference("interval of shuffled values", np.array(shuffled) / size, [mean, low, high], 0.0)


def single_value(number: int) -> Iterator[Measure]:
    """A single value has a mean and no interval.

    Args:
        number: Number of factors.

    Yields:
        Differences.
    """
    found = mean_interval(np.array([2.5]), [[0]] * number, confidence=0.95, **OPTIONS)
    yield difference("mean", found.mean, 2.5, 0.0)
    yield violations("ends that are numbers", ~np.isnan([found.low, found.high]))


def many_values(count: int) -> Iterator[Measure]:
    """Many independent values: the interval of the central limit theorem.

    Args:
        count: Number of values.

    Yields:
        Differences; half widths from 100 resamples are uncertain by a quarter.
    """
    values = np.random.default_rng(5).normal(size=count)
    found = mean_interval(values, [range(count)], resamples=100, confidence=0.95, seed=1)
    yield difference("mean", found.mean, math.fsum(values) / count, 1e-14)
    half = 1.96 * values.std() / math.sqrt(count)
    for end, sign in ((found.low, -1), (found.high, 1)):
        yield difference("end over half the width", sign * (end - found.mean) / half, 1.0, 0.4)


RELATIONS = ("equal", "opposite", "orthogonal", "zero")


def embeddings(dimension: int, relation: str) -> Iterator[Measure]:
    """Scores of embeddings in special positions.

    Args:
        dimension: Length of the embeddings.
        relation: Position of the second embedding relative to the first.

    Yields:
        Differences from closed forms.
    """
    one = np.random.default_rng(dimension).normal(size=dimension)
    one /= np.linalg.norm(one)
    if relation == "orthogonal" and dimension == 1:
        relation = "zero"
    cosine = {"equal": 1.0, "opposite": -1.0, "orthogonal": 0.0, "zero": 0.0}[relation]
    other = cosine * one
    if relation == "orthogonal":
        other = np.roll(one, 1) if dimension == 2 else np.random.default_rng(1).normal(size=dimension)
        other = other - one * (one @ other)
        other /= np.linalg.norm(other)
    first, second = np.tile(one, (3, 1)), np.tile(other, (3, 1))
    yield difference("CLIP-I", clip_i(first, other), np.full(3, cosine), 1e-14)
    yield difference("CLIPScore", clip_i_score(first, other), np.full(3, 2.5 * max(cosine, 0.0)), 1e-14)
    yield difference("DINO", dino_similarity(first, second), np.full(3, cosine), 1e-14)
    yield difference("CLIP-C", clip_c_adjacent(np.stack([one, other, one])), np.full(2, cosine), 1e-14)
    yield difference("CLIP-C of one frame", clip_c_adjacent(first[:1]), np.zeros(0), 0.0)
    # The change of the image is that of the text, its opposite, or nothing.
    change = 0.0 if relation == "equal" else 1.0
    yield difference("CLIP-D along the text", clip_d(second, first, other, one), np.full(3, change), 1e-12)
    yield difference("CLIP-D against the text", clip_d(second, first, one, other), np.full(3, -change), 1e-12)
    yield difference("CLIP-D of an unchanged image", clip_d(first, first, one, -one), np.zeros(3), 0.0)


POINT = StudyPoint("study", "subject", "variant", 0, 0.25, 0.25, "all")


def record(value: float | None) -> Iterator[Measure]:
    """Records hold finite numbers, or none and the reason.

    Args:
        value: Value of a metric.

    Yields:
        Contradictions.
    """
    row = metric_record(POINT, "test", (0, 0), "full", "psnr", value, "" if value is not None else "no truth")
    finite = value is not None and math.isfinite(value)
    yield Measure("value that is not the metric's", float(row.value != (value if finite else None)))
    yield Measure("reason beside a value, or none without", float(bool(row.reason) == finite))


_HEADER = ",".join(MetricRecord._fields)
_ROW = "s,a,v,0,0.25,0.25,all,test,0,0,full,psnr"
BROKEN_RECORDS = {
    "empty file": "",
    "another header": "a,b,c\n",
    "a value that is not a number": f"{_HEADER}\n{_ROW},nan,\n",
    "an infinite value": f"{_HEADER}\n{_ROW},inf,\n",
    "neither value nor reason": f"{_HEADER}\n{_ROW},,\n",
    "a missing cell": f"{_HEADER}\n{_ROW}\n",
    "text as value": f"{_HEADER}\n{_ROW},high,\n",
}


def read_records(text: str) -> list[Measure]:
    """A file of records that cannot be read.

    Args:
        text: Its content.

    Returns:
        Nothing: it is an error.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "metrics.csv"
        file.write_text(text)
        read_metrics([file])
    return []


if __name__ == "__main__":
    run(lambda: run_suite(__doc__, "metrics", cases()))
