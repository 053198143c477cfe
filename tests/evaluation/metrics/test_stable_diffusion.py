"""SD score in closed form, and the loading of a tiny Stable Diffusion model with random weights."""

import json
import shutil
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from tiny_diffusion import write_diffusion_model

from carigs.capture.frame_index import RenderedImage
from carigs.capture.images import write_png
from carigs.errors import InputError
from carigs.settings import Metrics
from carigs.weights.diffusers_parts import DiffusionParts
from evaluation.metrics import stable_diffusion
from evaluation.metrics.catalogue import CATALOGUE
from evaluation.metrics.networks.diffusion_model import encode, load_diffusion_model, predict_noise
from evaluation.metrics.stable_diffusion import SEEDS, TIMESTEPS, sd_records, sd_score
from evaluation.tables.metric_records import StudyPoint

SCHEDULE = np.cumprod(1 - np.linspace(0.00085**0.5, 0.012**0.5, 1000) ** 2)  # of Stable Diffusion
LATENTS = torch.randn((3, 4, 16, 16), generator=torch.Generator().manual_seed(7))


def noise_of(noisy, t, latents):
    """The noise in x_t, from the latents that the denoiser does not know."""
    return (noisy - SCHEDULE[t] ** 0.5 * latents) / (1 - SCHEDULE[t]) ** 0.5


@pytest.mark.parametrize(("factor", "score"), [(1, 1), (0, 0), (0.5, 0.75), (-1, -3)])
def test_a_multiple_of_the_true_noise_has_its_score(factor, score):
    def denoiser(noisy, t):
        return factor * noise_of(noisy, t, LATENTS)

    found = sd_score(denoiser, LATENTS, TIMESTEPS, SEEDS, SCHEDULE)
    np.testing.assert_allclose(found, score, atol=1e-5)


def test_the_best_denoiser_of_white_latents_has_the_score_of_the_schedule():
    # For z ~ N(0, I), x_t is N(0, I) too, and E[eps | x_t] = sqrt(1 - a) x_t is off by a |eps|^2 on average.
    latents = torch.randn((16, 4, 64, 64), generator=torch.Generator().manual_seed(1))
    found = sd_score(lambda noisy, t: (1 - SCHEDULE[t]) ** 0.5 * noisy, latents, TIMESTEPS, SEEDS, SCHEDULE)
    expected = 1 - SCHEDULE[list(TIMESTEPS)].mean()
    assert found.mean() == pytest.approx(expected, rel=0.004)


def test_blur_is_rewarded():
    # Wiener's denoiser of latents with variance s^2 scores 1 - mean a s^2 / (a s^2 + 1 - a), which grows as s falls.
    def score(deviation):
        def denoiser(noisy, t):
            return (1 - SCHEDULE[t]) ** 0.5 / (SCHEDULE[t] * deviation**2 + 1 - SCHEDULE[t]) * noisy

        return sd_score(denoiser, deviation * LATENTS, TIMESTEPS, SEEDS, SCHEDULE).mean()

    share = SCHEDULE[list(TIMESTEPS)]
    for deviation in (1.0, 0.5, 0.1):
        expected = 1 - np.mean(share * deviation**2 / (share * deviation**2 + 1 - share))
        assert score(deviation) == pytest.approx(expected, rel=0.04)
    assert score(0.1) > score(0.5) > score(1.0)


def test_each_ratio_is_taken_before_the_mean():
    # A denoiser that fails at one of two timesteps, with the error 9 |eps|^2 there: 1 - (0 + 9) / 2.
    def denoiser(noisy, t):
        return noise_of(noisy, t, LATENTS) * (1 if t == 100 else -2)

    np.testing.assert_allclose(sd_score(denoiser, LATENTS, (100, 900), (0,), SCHEDULE), 1 - 4.5, atol=1e-4)


def test_all_images_get_the_same_noise_whatever_their_order_and_batch():
    def denoiser(noisy, t):
        return torch.tanh(noisy) * (0.2 + t / 1000)

    together = sd_score(denoiser, LATENTS, TIMESTEPS, SEEDS, SCHEDULE)
    reversed_ = sd_score(denoiser, LATENTS.flip(0), TIMESTEPS, SEEDS, SCHEDULE)
    alone = [sd_score(denoiser, latent[None], TIMESTEPS, SEEDS, SCHEDULE)[0] for latent in LATENTS]
    np.testing.assert_allclose(reversed_[::-1], together, rtol=1e-6)
    np.testing.assert_allclose(alone, together, rtol=1e-6)
    assert len(np.unique(together.round(5))) == 3
    twins = sd_score(denoiser, LATENTS[:1].repeat(2, 1, 1, 1), TIMESTEPS, SEEDS, SCHEDULE)
    assert twins[0] == twins[1]


def test_every_timestep_and_seed_has_noise_of_its_own():
    drawn = []

    def denoiser(noisy, t):
        drawn.append(noise_of(noisy, t, 0 * noisy).numpy().ravel())
        return noisy

    sd_score(denoiser, torch.zeros(1, 4, 64, 64), TIMESTEPS, SEEDS, SCHEDULE)
    correlation = np.corrcoef(drawn)
    assert correlation.shape == (40, 40) and np.abs(correlation - np.eye(40)).max() < 5 / 128
    assert TIMESTEPS[0] == 20 and TIMESTEPS[-1] == 980 and len(set(np.diff(TIMESTEPS))) <= 2


def test_a_prediction_of_v_gives_the_noise():
    noise = torch.randn(LATENTS.shape, generator=torch.Generator().manual_seed(2))
    share = SCHEDULE[400]

    class Unet(torch.nn.Module):
        def forward(self, _noisy, _timestep, encoder_hidden_states):
            assert encoder_hidden_states.shape == (3, 2, 5)
            v = share**0.5 * noise - (1 - share) ** 0.5 * LATENTS
            return type("Output", (), {"sample": v})

    model = DiffusionParts(None, Unet(), torch.zeros(1, 2, 5), SCHEDULE, "v_prediction")
    noisy = share**0.5 * LATENTS + (1 - share) ** 0.5 * noise
    torch.testing.assert_close(predict_noise(model, noisy, 400), noise)


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    """A folder in the layout of Stable Diffusion."""
    return write_diffusion_model(tmp_path_factory.mktemp("models") / "tiny", scaling_factor=0.25, shift_factor=0.5)


@pytest.fixture
def copy(tiny, tmp_path):
    return shutil.copytree(tiny, tmp_path / "copy")


def edit(file, **changes):
    file.write_text(json.dumps({**json.loads(file.read_text()), **changes}))


@pytest.mark.slow
def test_loading_gives_the_saved_networks_the_schedule_and_the_empty_prompt(tiny):
    from diffusers import AutoencoderKL, UNet2DConditionModel
    from transformers import CLIPTextModel

    model = load_diffusion_model(tiny)
    np.testing.assert_allclose(model.alphas_cumprod, SCHEDULE, rtol=1e-4)
    tokens = torch.tensor([[0, 1, 1, 1, 1, 1, 1]])  # start, end, padding
    image = np.random.default_rng(0).integers(0, 256, (512, 512, 3)).astype(np.uint8)
    with torch.inference_mode():
        prompt = CLIPTextModel.from_pretrained(tiny / "text_encoder").eval()(tokens).last_hidden_state
        torch.testing.assert_close(model.prompts, prompt)
        unet = UNet2DConditionModel.from_pretrained(tiny / "unet", low_cpu_mem_usage=False).eval()
        noisy = torch.randn(2, 4, 64, 64)
        expected = unet(noisy, 300, encoder_hidden_states=prompt.repeat(2, 1, 1)).sample
        torch.testing.assert_close(predict_noise(model, noisy, 300), expected)
        vae = AutoencoderKL.from_pretrained(tiny / "vae", low_cpu_mem_usage=False).eval()
        mean = vae.encode(torch.from_numpy(image).permute(2, 0, 1)[None] / 127.5 - 1).latent_dist.mean[0]
    torch.testing.assert_close(encode(model, image), 0.25 * (mean - 0.5), atol=1e-4, rtol=1e-4)


@pytest.mark.slow
def test_the_score_of_an_image_does_not_depend_on_the_batch(tiny):
    model = load_diffusion_model(tiny)
    images = [np.random.default_rng(seed).integers(0, 256, (90, 60, 3)).astype(np.uint8) for seed in range(2)]
    latents = torch.stack([encode(model, image) for image in images])
    denoiser, schedule = partial(predict_noise, model), model.alphas_cumprod
    together = sd_score(denoiser, latents, (20, 980), (0, 1), schedule)
    alone = [sd_score(denoiser, z[None], (20, 980), (0, 1), schedule)[0] for z in latents]
    np.testing.assert_allclose(together, alone, rtol=1e-5)
    assert together[0] != together[1]


@pytest.mark.slow
def test_files_that_cannot_be_used_are_refused_in_one_line(copy):
    def problem():
        with pytest.raises(InputError) as caught:
            load_diffusion_model(copy)
        assert "\n" not in str(caught.value) and str(copy) in str(caught.value)
        return str(caught.value)

    edit(copy / "scheduler/scheduler_config.json", prediction_type="sample")
    assert "sample is unknown" in problem()
    weights = copy / "unet/diffusion_pytorch_model.safetensors"
    whole = weights.read_bytes()
    weights.write_bytes(whole[: len(whole) // 2])
    assert "not a readable part" in problem()
    from safetensors.torch import load_file, save_file

    weights.write_bytes(whole)
    parameters = load_file(weights)
    del parameters["conv_in.weight"]
    save_file(parameters, weights)
    assert "conv_in.weight" in problem()
    (copy / "vae/config.json").unlink()
    assert "has no file vae/config.json" in problem()


@pytest.mark.slow
def test_a_model_whose_latents_have_another_scale_gives_no_score(copy, tmp_path, monkeypatch):
    """The definition in the tables states the scale."""
    monkeypatch.setattr(stable_diffusion, "find_weights", lambda *_, **__: copy)
    write_png(tmp_path / "frame.png", np.random.default_rng(0).random((40, 30, 3)))
    frames = [RenderedImage("test", 3, 1, 0, tmp_path / "frame.png")]
    point, subject = StudyPoint("s", "anna", "v", 0, 0.25, 0.25, "files"), SimpleNamespace(background=1.0)

    def records():
        return list(sd_records(point, frames, subject, Metrics(diffusion=("sd_1.5",))))

    with pytest.raises(InputError, match=r"vae/config\.json: scaling_factor: .* 0\.18215, not 0\.25"):
        records()
    edit(copy / "vae/config.json", scaling_factor=0.18215)
    (record,) = records()
    assert (record.metric, record.timestep, record.camera, record.reason) == ("sd_1.5", 3, 1, "")
    assert np.isfinite(record.value) and record.value < 1
    assert "0.18215" in CATALOGUE["sd_1.5"].source
