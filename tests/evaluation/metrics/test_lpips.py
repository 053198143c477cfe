"""LPIPS on trunks with random weights: distance axioms, the conventions, regions, and torchmetrics as the oracle."""

import numpy as np
import pytest

from carigs.errors import InputError
from evaluation.metrics.lpips import LPIPS_METRICS, load_lpips, lpips

SIZE = (72, 96)


def smooth_image(seed: int, size=SIZE) -> np.ndarray:
    random = np.random.default_rng(seed)
    y, x = np.mgrid[: size[0], : size[1]][..., None] / 20
    waves = [np.sin(a * x + b * y + c) for a, b, c in random.uniform(-3, 3, (6, 3, 3))]
    return (0.5 + 0.4 * np.mean(waves, axis=0)).clip(0, 1).astype(np.float32)


def save_trunk(folder, trunk):
    import torch
    import torchvision

    torch.manual_seed(0)
    model = {"alex": torchvision.models.alexnet, "vgg": torchvision.models.vgg16}[trunk](weights=None)
    file = folder / f"{trunk}.pth"
    torch.save({name: value for name, value in model.state_dict().items() if name.startswith("features.")}, file)
    return file, model


@pytest.fixture(scope="module")
def alex(tmp_path_factory):
    return load_lpips("alex", save_trunk(tmp_path_factory.mktemp("weights"), "alex")[0])


def whole(network, image, truth, normalize=True):
    region = {"full": np.ones(image.shape[:2], bool)}
    return lpips(network, image, truth, region, normalize=normalize)["full"]


@pytest.mark.slow
def test_equal_images_have_distance_zero_and_the_distance_is_symmetric(alex):
    image, other = smooth_image(0), smooth_image(1)
    assert whole(alex, image, image) == 0
    assert whole(alex, image, other) == pytest.approx(whole(alex, other, image), rel=1e-6)
    assert whole(alex, image, other) > 0


def test_the_distance_grows_with_the_shift(alex):
    image = smooth_image(0, (72, 128))
    distances = [whole(alex, image[:, 16:112], image[:, 16 + shift : 112 + shift]) for shift in (0, 1, 2, 4, 8)]
    assert distances[0] == 0 and (np.diff(distances) > 0).all()


def test_the_raw_convention_is_the_other_on_images_of_half_the_contrast(alex):
    # The network expects 2 x - 1. Fed with x, it sees the image (1 + x) / 2.
    image, truth = smooth_image(0), smooth_image(1)
    raw = whole(alex, image, truth, LPIPS_METRICS["lpips_alex_3dgs"].normalize)
    scaled = whole(alex, (1 + image) / 2, (1 + truth) / 2, LPIPS_METRICS["lpips_alex"].normalize)
    assert raw == pytest.approx(scaled, rel=1e-4)
    assert raw < 0.8 * whole(alex, image, truth)


def test_two_halves_average_to_the_whole(alex):
    image, truth = smooth_image(0), smooth_image(1)
    truth[:, :30] = image[:, :30]  # so that the halves differ
    left = np.zeros(SIZE, bool)
    left[:, :48] = True
    halves = lpips(alex, image, truth, {"left": left, "right": ~left}, normalize=True)
    assert halves["left"] < 0.8 * halves["right"]
    assert np.mean(list(halves.values())) == pytest.approx(whole(alex, image, truth), rel=1e-6)


def test_a_region_does_not_see_what_is_far_away(alex):
    image = smooth_image(0, (72, 400))
    truth = image.copy()
    truth[:, :20] = 1 - truth[:, :20]
    near = np.zeros(image.shape[:2], bool)
    near[:, :40] = True
    far = np.zeros_like(near)
    far[:, 250:] = True  # AlexNet's last features see 195 pixels
    distances = lpips(alex, image, truth, {"near": near, "far": far}, normalize=True)
    assert distances["near"] > 0 and distances["far"] == 0


def test_an_empty_region_has_no_distance(alex):
    image = smooth_image(0)
    assert np.isnan(lpips(alex, image, image, {"none": np.zeros(SIZE, bool)}, normalize=True)["none"])


def test_weights_of_another_network_are_refused_in_one_line(tmp_path):
    import torch

    torch.save({"features.0.weight": torch.zeros(3)}, tmp_path / "other.pth")
    with pytest.raises(InputError, match="not AlexNet") as caught:
        load_lpips("alex", tmp_path / "other.pth")
    assert "\n" not in str(caught.value)


@pytest.mark.slow
@pytest.mark.parametrize("trunk", ["alex", "vgg"])
def test_the_whole_image_has_torchmetrics_own_value(tmp_path, monkeypatch, trunk):
    import torch
    from torchmetrics.functional.image import learned_perceptual_image_patch_similarity
    from torchvision.models import _api

    file, model = save_trunk(tmp_path, trunk)
    monkeypatch.setattr(_api, "load_state_dict_from_url", lambda *_args, **_kwargs: model.state_dict())
    images = [smooth_image(seed) for seed in (0, 1)]
    batches = [torch.from_numpy(image).permute(2, 0, 1)[None] for image in images]
    network = load_lpips(trunk, file)
    expected = learned_perceptual_image_patch_similarity(*batches, net_type=trunk, normalize=True)
    assert whole(network, *images) == pytest.approx(float(expected), rel=1e-5)
    raw = learned_perceptual_image_patch_similarity(*batches, net_type=trunk, normalize=False)
    assert whole(network, *images, normalize=False) == pytest.approx(float(raw), rel=1e-5)
