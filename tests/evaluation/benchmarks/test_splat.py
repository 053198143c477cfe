"""The benchmark of the surfel engine takes all measurements, and its references are independent."""

import csv

import numpy as np
import pytest
import torch

from carigs.capture.images import read_rgb
from carigs.splat.training.photometric_loss import photometric_loss
from evaluation.benchmarks.measurement.synthetic_scenes import portrait, surfels_on_ellipsoid
from evaluation.benchmarks.splat import QUICK, benchmark
from evaluation.benchmarks.surfel_pixel_pairs import contributing_pairs
from evaluation.benchmarks.training_speed import torch_photometric

QUANTITIES = {
    "projection", "binning", "forward", "backward", "projection backward", "all kernels", "with torch around them",
    "plain loops / all kernels", "contributing pairs", "forward per pair", "backward per pair",
    "L1 + SSIM", "torch / fused L1 + SSIM", "skinning forward", "skinning backward",
    "colours forward", "colours backward",
    "training step", "rendering", "forward and backward", "import", "first rendering and gradient",
}  # fmt: skip


def count_by_rays(surfels, camera):
    """Every ray against every disc in world space."""
    centre, u, v = (t.detach().numpy().astype(float) for t in (surfels.centre, surfels.tangent_u, surfels.tangent_v))
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    ray = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], axis=2)
    ray = ray @ camera.camera_from_world[:3, :3]
    transmittance, ended, pairs = np.ones(x.shape), np.zeros(x.shape, bool), 0
    for i in np.argsort(camera.project(centre)[1]):
        normal = np.cross(u[i], v[i])
        hit = camera.centre + ray * (((centre[i] - camera.centre) @ normal) / (ray @ normal))[..., None]
        on_disc = (hit - centre[i]) @ np.linalg.pinv(np.stack([u[i], v[i]], axis=1)).T
        alpha = surfels.opacity[i].item() * np.exp(-(on_disc**2).sum(axis=2) / 2)
        touched = (alpha >= 1 / 255) & ~ended
        after = transmittance * (1 - np.minimum(alpha, 0.99))
        ended |= touched & (after <= 1e-4)
        pairs += np.count_nonzero(touched & ~ended)
        transmittance = np.where(touched & ~ended, after, transmittance)
    return pairs


@pytest.mark.parametrize("spread", [1.0, 6.0])
def test_pairs_are_those_of_a_count_ray_by_ray(spread):
    surfels, camera = surfels_on_ellipsoid(150, spread=spread), portrait(45, 60, side=0.3)
    assert contributing_pairs(surfels, camera) == pytest.approx(count_by_rays(surfels, camera), rel=1e-3)


def test_the_ellipsoid_covers_half_of_the_image_whatever_the_size():
    for count, size in ((3000, (100, 140)), (12000, (64, 64))):
        surfels, camera = surfels_on_ellipsoid(count), portrait(*size)
        pixels, _ = camera.project(surfels.centre.detach().numpy().astype(float))
        assert len(surfels.centre) == count
        assert 0.4 < np.ptp(pixels, axis=0).prod() * np.pi / 4 / (camera.width * camera.height) < 0.6


@pytest.mark.slow
def test_what_the_loss_is_compared_with_is_the_same_loss():
    image, target = torch.rand((2, 3, 40, 30), generator=torch.Generator().manual_seed(0))
    fused = photometric_loss(image.permute(1, 2, 0), target.permute(1, 2, 0))
    assert torch_photometric(image, target).item() == pytest.approx(fused.item(), rel=1e-5)


@pytest.mark.slow
def test_the_quick_benchmark_measures_everything(tmp_path):
    benchmark(tmp_path / "splat.csv", QUICK)
    with (tmp_path / "splat.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert {row["quantity"] for row in rows} == QUANTITIES
    assert len({(row["case"], row["quantity"]) for row in rows}) == len(rows)
    numbers = [float(row[name]) for row in rows for name in ("value", "reference") if row[name]]
    assert np.isfinite(numbers).all() and min(numbers) > 0
    assert read_rgb(tmp_path / "splat.png").std() > 0
