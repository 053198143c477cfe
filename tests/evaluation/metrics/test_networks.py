"""The loading and embedding code, on tiny random networks of open_clip's and timm's own classes."""

import hashlib
from functools import partial

import numpy as np
import pytest

from carigs.capture.images import write_png
from carigs.errors import InputError
from evaluation.metrics import clip, dino
from evaluation.metrics.embeddings import Embedder, clip_scores
from evaluation.metrics.preprocessing import CLIP_STATISTICS, IMAGENET_STATISTICS, preprocess

TINY_CLIP = {
    "embed_dim": 32,
    "quick_gelu": True,
    "vision_cfg": {"image_size": 64, "layers": 2, "width": 64, "head_width": 32, "patch_size": 32},
    "text_cfg": {"context_length": 77, "vocab_size": 49408, "width": 32, "heads": 2, "layers": 2},
}
TINY_DINO = "test_vit"  # timm's own miniature


def prepare(size, statistics=CLIP_STATISTICS):
    return partial(preprocess, size=size, statistics=statistics, crop="pad_square")


@pytest.fixture(scope="module")
def frames(tmp_path_factory):
    folder, generator = tmp_path_factory.mktemp("frames"), np.random.default_rng(0)
    files = [folder / f"{i}.png" for i in range(11)]
    for file in files:
        write_png(file, generator.random((40, 30, 3)))
    return files


@pytest.fixture(scope="module")
def tiny_clip(tmp_path_factory):
    import open_clip
    import torch

    torch.manual_seed(0)
    file = tmp_path_factory.mktemp("weights") / "tiny.pt"
    model = open_clip.CLIP(**TINY_CLIP).eval()
    torch.save(model.state_dict(), file)
    return file, model


@pytest.mark.filterwarnings("ignore:.torch.jit:DeprecationWarning")
@pytest.mark.parametrize("kind", ["plain", "safetensors", "torchscript"])
def test_loading_gives_the_saved_network_back(tiny_clip, tmp_path, kind):
    import torch
    from safetensors.torch import save_file

    file, model = tiny_clip
    if kind == "safetensors":
        file = tmp_path / "tiny.safetensors"
        save_file(model.state_dict(), file)
    elif kind == "torchscript":  # what OpenAI publishes: an archive whose state also holds three numbers
        file = tmp_path / "tiny_script.pt"
        carrier = torch.nn.Module()
        carrier.register_buffer("input_resolution", torch.tensor(64))
        for name, value in model.state_dict().items():
            owner = carrier
            *path, leaf = name.split(".")
            for part in path:
                if part not in dict(owner.named_children()):
                    owner.add_module(part, torch.nn.Module())
                owner = owner.get_submodule(part)
            owner.register_buffer(leaf, value)
        torch.jit.script(carrier).save(file)
        with pytest.raises(InputError, match="TorchScript"):
            clip.load_clip(file, TINY_CLIP)
    trusted = [hashlib.sha256(file.read_bytes()).hexdigest()]
    image = torch.rand(2, 3, 64, 64, generator=torch.Generator().manual_seed(0))
    with torch.inference_mode():
        assert torch.equal(clip.load_clip(file, TINY_CLIP, trusted).encode_image(image), model.encode_image(image))


def test_another_activation_than_quick_gelu_is_refused(tiny_clip):
    with pytest.raises(InputError, match="QuickGELU"):
        clip.load_clip(tiny_clip[0], {**TINY_CLIP, "quick_gelu": False})


def test_weights_of_another_network_are_refused_in_one_line(tiny_clip):
    with pytest.raises(InputError) as caught:
        clip.load_clip(tiny_clip[0], {**TINY_CLIP, "embed_dim": 48})
    assert "not CLIP" in str(caught.value) and "\n" not in str(caught.value)


def test_embeddings_do_not_depend_on_the_batch_and_are_made_once(tiny_clip, frames):
    model, calls = tiny_clip[1], []

    def network(batch):
        calls.append(len(batch))
        return model.encode_image(batch)

    together, alone = Embedder(network, prepare(64)), Embedder(network, prepare(64))
    found = together(frames)
    np.testing.assert_allclose(np.concatenate([alone([file]) for file in frames]), found, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1)
    calls.clear()
    np.testing.assert_array_equal(together([*frames[::-1], *frames]), np.concatenate([found[::-1], found]))
    assert calls == []


def test_scores_of_frames_that_do_nothing(tiny_clip, frames):
    texts = clip.embed_texts(tiny_clip[1], ["a head", "a caricature of a head with a huge nose"])
    np.testing.assert_allclose(np.linalg.norm(texts, axis=1), 1)
    embed = Embedder(tiny_clip[1].encode_image, prepare(64))
    scores = clip_scores(embed, texts, frames, frames, [frames[0]] * 4)
    assert (scores["clip_d"] == 0).all()
    np.testing.assert_allclose(scores["clip_c_adjacent"], 1)
    np.testing.assert_allclose(scores["clip_i_score_w2.5"], 2.5 * np.maximum(scores["clip_i_cos"], 0))
    assert {name: len(values) for name, values in scores.items()} == {
        "clip_i_cos": 11, "clip_i_score_w2.5": 11, "clip_d": 11, "clip_c_adjacent": 3
    }  # fmt: skip


@pytest.mark.parametrize("shape", [(80, 55), (55, 80), (64, 64), (401, 275)])
def test_the_centre_crop_is_open_clips_own_pipeline(shape):
    from open_clip.transform import image_transform
    from PIL import Image

    pixels = np.random.default_rng(0).integers(0, 256, (*shape, 3)).astype(np.uint8)
    mean, deviation = CLIP_STATISTICS
    reference = image_transform(48, is_train=False, mean=mean, std=deviation)(Image.fromarray(pixels))
    found = preprocess(pixels / 255, 48, CLIP_STATISTICS, "center")
    assert found.shape == reference.shape
    assert float((found - reference).abs().max()) < 0.05


def test_padding_keeps_all_of_a_portrait_and_fills_with_the_background():
    image = np.zeros((80, 40, 3))
    found = preprocess(image, 32, ((0, 0, 0), (1, 1, 1)), "pad_square", background=0.25)
    assert found.shape == (3, 32, 32)
    assert float(found[:, :, 10:22].abs().max()) == 0  # away from the seam
    np.testing.assert_allclose(found[:, :, :6], 0.25, atol=1e-6)
    np.testing.assert_allclose(found[:, :, -6:], 0.25, atol=1e-6)


def test_a_square_image_is_not_padded():
    image = np.random.default_rng(0).random((50, 50, 3))
    padded, cropped = (preprocess(image, 32, CLIP_STATISTICS, crop) for crop in ("pad_square", "center"))
    np.testing.assert_array_equal(padded, cropped)


def test_dino_gives_the_final_class_token(tmp_path, frames):
    import timm
    import torch

    torch.manual_seed(0)
    model = timm.create_model(TINY_DINO, num_classes=0, global_pool="token").eval()
    torch.save(model.state_dict(), tmp_path / "tiny.pth")
    network = dino.load_dino(tmp_path / "tiny.pth", TINY_DINO)
    batch = torch.stack(
        [prepare(160, IMAGENET_STATISTICS)(np.random.default_rng(i).random((40, 30, 3))) for i in (0, 1)]
    )
    with torch.inference_mode():
        assert torch.equal(network(batch), model.forward_features(batch)[:, 0])
    with pytest.raises(InputError, match="not DINO"):
        dino.load_dino(tmp_path / "tiny.pth", "test_vit2")
