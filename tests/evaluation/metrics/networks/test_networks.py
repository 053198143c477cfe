"""CLIP and DINO on tiny random networks of open_clip's and timm's own classes, and on their weights where these are."""

import hashlib

import numpy as np
import pytest

from carigs.errors import InputError, WeightsMissing
from carigs.weights.registry import registered
from carigs.weights.search import find_weights
from evaluation.metrics.networks import clip, dino
from evaluation.metrics.networks.preprocessing import Preprocessing

TINY_CLIP = {
    "embed_dim": 32,
    "quick_gelu": True,
    "vision_cfg": {"image_size": 64, "layers": 2, "width": 64, "head_width": 32, "patch_size": 32},
    "text_cfg": {"context_length": 77, "vocab_size": 49408, "width": 32, "heads": 2, "layers": 2},
}
TINY_DINO = "test_vit"  # timm's own miniature


def weights_or_skip(name):
    try:
        return find_weights(registered(name), None)
    except WeightsMissing as missing:
        pytest.skip(str(missing))


@pytest.fixture(scope="module")
def tiny_clip(tmp_path_factory):
    import open_clip
    import torch

    torch.manual_seed(0)
    file = tmp_path_factory.mktemp("weights") / "tiny.pt"
    model = open_clip.CLIP(**TINY_CLIP).eval()
    torch.save(model.state_dict(), file)
    return file, model


@pytest.mark.filterwarnings("ignore:.torch.jit")  # of which class depends on the version
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


def images(size, count=2):
    import torch

    return torch.rand(count, 3, size, size, generator=torch.Generator().manual_seed(0))


def test_texts_are_normalised_and_embedded_one_by_one(tiny_clip):
    texts = ["a head", "a caricature of a head with a huge nose"]
    together = clip.embed_texts(tiny_clip[1], texts)
    np.testing.assert_allclose(np.linalg.norm(together, axis=1), 1)
    np.testing.assert_allclose(
        np.concatenate([clip.embed_texts(tiny_clip[1], [t]) for t in texts]), together, atol=1e-6
    )


@pytest.fixture(scope="module")
def tiny_dino(tmp_path_factory):
    import timm
    import torch

    torch.manual_seed(0)
    file = tmp_path_factory.mktemp("weights") / "tiny.pth"
    model = timm.create_model(TINY_DINO, num_classes=0, global_pool="token").eval()
    torch.save(model.state_dict(), file)
    return file, model


def test_dino_gives_the_final_class_token(tiny_dino):
    import torch

    file, model = tiny_dino
    with torch.inference_mode():
        assert torch.equal(dino.load_dino(file, TINY_DINO)(images(160)), model.forward_features(images(160))[:, 0])
    with pytest.raises(InputError, match="not DINO"):
        dino.load_dino(file, "test_vit2")


def test_one_pass_gives_the_class_token_and_the_patches_of_the_last_block(tiny_dino):
    import torch

    file, model = tiny_dino
    seen = {}
    model.blocks[-1].register_forward_hook(lambda module, inputs, output: seen.update(last=output))
    with torch.inference_mode():
        tokens, patches = dino.class_and_patch_tokens(model, images(160))
        torch.testing.assert_close(tokens, dino.load_dino(file, TINY_DINO)(images(160)))
    expected = torch.nn.functional.normalize(seen["last"][:, 1:], dim=2)  # without the class token
    torch.testing.assert_close(patches.float().reshape(expected.shape), expected, atol=1e-3, rtol=0)


def test_the_cosine_of_patch_features_is_the_mean_cosine_of_the_patches(tiny_dino):
    import torch

    with torch.inference_mode():
        _, patches = dino.class_and_patch_tokens(tiny_dino[1], images(160))
    features = patches.double().numpy()
    count = (160 // tiny_dino[1].patch_embed.patch_size[0]) ** 2
    first, second = features.reshape(2, count, -1)
    unit = features / np.linalg.norm(features, axis=1, keepdims=True)
    similarity = dino.dino_similarity(unit[:1], unit[1:])
    np.testing.assert_allclose(similarity, (first * second).sum(axis=1).mean(), atol=1e-3)


@pytest.mark.weights
def test_openais_weights_order_prompts_as_they_should():
    """An image of a red square is nearest to the prompt that says so."""
    import torch

    model = clip.load_clip(weights_or_skip(clip.WEIGHTS))
    prepare = Preprocessing(*clip.STATISTICS)
    colours = {"red": (255, 0, 0), "green": (0, 160, 0), "blue": (0, 0, 255)}
    squares = [np.broadcast_to(np.uint8(colour), (300, 200, 3)) for colour in colours.values()]
    with torch.inference_mode():
        embedded = model.encode_image(torch.stack([prepare(square) for square in squares]), normalize=True).numpy()
    cosines = embedded @ clip.embed_texts(model, [f"a plain {name} square" for name in colours]).T
    assert (cosines.argmax(axis=1) == [0, 1, 2]).all()
    assert 0.1 < cosines.min() < cosines.max() < 0.45  # as of all images and texts


@pytest.mark.weights
@pytest.mark.parametrize("name", dino.MODELS)
def test_dinos_weights_see_a_moved_object_as_similar_and_another_one_as_different(name):
    import torch

    network = dino.load_dino(weights_or_skip(name), dino.MODELS[name])
    prepare = Preprocessing(*dino.STATISTICS)
    y, x = np.mgrid[:224, :224]
    disc = [(x - cx) ** 2 + (y - 112) ** 2 < 50**2 for cx in (100, 124)]
    stripes = (x // 14) % 2 == 0
    pictures = [np.where(mask[..., None], np.uint8([200, 60, 40]), np.uint8(255)) for mask in (*disc, stripes)]
    with torch.inference_mode():
        a, moved, other = torch.nn.functional.normalize(network(torch.stack([prepare(p) for p in pictures])))
    assert a @ moved > a @ other + 0.1
