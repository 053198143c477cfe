"""InstructPix2Pix and ControlNet with tiny random weights: the networks of diffusers, as the files hold them."""

import json
import pickle
import shutil
import time

import numpy as np
import pytest
import torch
from tiny_diffusion import write_controlnet, write_diffusion_model

from carigs.editing.editor import make_editor
from carigs.editing.instruct_pix2pix import InstructPix2Pix
from carigs.errors import InputError, WeightsMissing
from carigs.settings import Edit

SIZE = 64


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    """A folder of weights as CARIGS_WEIGHTS names it."""
    folder = tmp_path_factory.mktemp("weights")
    write_diffusion_model(folder / "instruct-pix2pix", in_channels=8, sample_size=SIZE // 8)
    write_diffusion_model(folder / "stable-diffusion-v1-5", sample_size=SIZE // 8)
    write_controlnet(folder / "control_v11e_sd15_ip2p")
    return folder


@pytest.fixture
def edit(weights, capture):
    """Edits a view with changed settings."""

    def edited(view, editor="instruct_pix2pix", **settings):
        return make_editor(Edit(**{"editor": editor, "steps": 3, **settings}), capture, 0)(view)

    return edited


NETWORKS = pytest.mark.parametrize("editor", ["instruct_pix2pix", "controlnet_ip2p"])


@pytest.mark.slow
@NETWORKS
def test_an_edit_depends_on_all_that_it_is_to_depend_on_and_is_the_same_again(edit, view, editor):
    image = edit(view(), editor, prompt="no")
    assert image.shape == (96, 80, 3) and image.dtype == np.float32 and 0 <= image.min() < image.max() <= 1
    np.testing.assert_array_equal(edit(view(), editor, prompt="no"), image)
    grey = np.full_like(image, 0.5)
    others = {
        "seed": edit(view(seed=(1,)), editor, prompt="no"),
        "rendered": edit(view(rendered=grey), editor, prompt="no"),
        "captured": edit(view()._replace(captured=grey), editor, prompt="no"),
        "prompt": edit(view(), editor, prompt="nose"),
        "text_guidance": edit(view(), editor, prompt="no", text_guidance=3.0),
        "steps": edit(view(), editor, prompt="no", steps=2),
        "noise": edit(view(), editor, prompt="no", noise=0.3),
    }
    if editor == "instruct_pix2pix":
        others["image_guidance"] = edit(view(), editor, prompt="no", image_guidance=4.0)
    assert {name for name, other in others.items() if np.array_equal(other, image)} == set()


@pytest.mark.slow
def test_instruct_pix2pix_is_guided_by_three_passes_of_the_network(weights, capture, view):
    """Against the network of diffusers, called for one condition at a time."""
    editor = make_editor(Edit(editor="instruct_pix2pix", prompt="nose", text_guidance=3, image_guidance=2), capture, 0)
    unet, vae, (text, empty) = editor.parts.unet, editor.parts.vae, editor.parts.prompts[:, None]
    captured, x = view().captured, torch.randn((1, 4, SIZE // 8, SIZE // 8), generator=torch.Generator().manual_seed(1))
    with torch.inference_mode():
        condition = vae.encode(2 * editor.pixels(captured) - 1).latent_dist.mean
        found = editor.prepare(captured)(x, 300)

        def output(image, prompt):
            return unet(torch.cat([x, image], dim=1), 300, encoder_hidden_states=prompt).sample

        none, image, full = output(0 * condition, empty), output(condition, empty), output(condition, text)
    torch.testing.assert_close(found, none + 2 * (image - none) + 3 * (full - image), atol=1e-5, rtol=1e-4)


@pytest.mark.slow
def test_the_control_network_steers_by_the_captured_image(weights, capture, view):
    editor = make_editor(Edit(editor="controlnet_ip2p", prompt="nose", text_guidance=4), capture, 0)
    captured, x = view().captured, torch.randn((1, 4, SIZE // 8, SIZE // 8), generator=torch.Generator().manual_seed(1))
    with torch.inference_mode():
        found = editor.prepare(captured)(x, 300)
        outputs = []
        for prompt in editor.parts.prompts[:, None]:
            down, middle = editor.control(x, 300, prompt, editor.pixels(captured), return_dict=False)
            outputs.append(
                editor.parts.unet(
                    x,
                    300,
                    encoder_hidden_states=prompt,
                    down_block_additional_residuals=down,
                    mid_block_additional_residual=middle,
                ).sample
            )
        text, empty = outputs
        alone = editor.parts.unet(x, 300, encoder_hidden_states=editor.parts.prompts[:1]).sample
    torch.testing.assert_close(found, empty + 4 * (text - empty), atol=1e-5, rtol=1e-4)
    assert (text - alone).abs().max() > 1e-3


@pytest.mark.parametrize("shape", [(90, 60), (60, 90), (64, 64), (200, 150)])
def test_padding_and_scaling_are_undone(shape):
    """An autoencoder that passes everything on: what comes back is the image, but for the scaling."""

    class Passing:
        config = type("Config", (), {"block_out_channels": (1, 1, 1, 1)})
        encode = staticmethod(lambda x: type("E", (), {"latent_dist": type("D", (), {"mode": lambda _: x})()}))
        decode = staticmethod(lambda z: type("O", (), {"sample": z}))

    parts = type("Parts", (), {"vae": Passing, "device": "cpu", "latent_scale": 1.0})
    parts.unet = type("Unet", (), {"config": type("Config", (), {"sample_size": SIZE // 8})})
    editor = InstructPix2Pix(parts, Edit(), 1.0)
    y, x = np.mgrid[: shape[0], : shape[1]] / 100
    image = np.stack([0.5 + 0.3 * np.sin(3 * x), 0.5 + 0.3 * np.cos(2 * y), 0.2 + 0.1 * x], axis=-1).astype(np.float32)
    back = editor.decode(editor.encode(image), shape)
    assert back.shape == image.shape
    inner = (slice(6, -6), slice(6, -6))  # the padding bleeds over the border
    np.testing.assert_allclose(back[inner], image[inner], atol=0.02)


@NETWORKS
def test_missing_weights_are_named_at_once_with_the_command(no_weights, capture, editor):
    started = time.perf_counter()
    names = {"instruct_pix2pix": "instruct_pix2pix", "controlnet_ip2p": "stable_diffusion_1.5"}
    with pytest.raises(WeightsMissing, match=f"carigs weights fetch {names[editor]}"):
        make_editor(Edit(editor=editor), capture, 0)
    assert time.perf_counter() - started < 1


class Harmful:
    """Makes a file where it is unpickled."""

    def __init__(self, file):
        self.file = str(file)

    def __reduce__(self):
        return open, (self.file, "w")


@pytest.mark.slow
@NETWORKS
def test_files_that_cannot_be_used_are_refused_in_one_line(weights, capture, editor, tmp_path):
    def problem():
        started = time.perf_counter()
        with pytest.raises(InputError) as caught:
            make_editor(Edit(editor=editor), capture, 0)
        assert time.perf_counter() - started < 1
        assert "\n" not in str(caught.value) and str(weights) in str(caught.value)
        return str(caught.value)

    make_editor(Edit(editor=editor), capture, 0)  # imports
    part = {"instruct_pix2pix": "instruct-pix2pix/unet", "controlnet_ip2p": "control_v11e_sd15_ip2p"}[editor]
    file = weights / part / "diffusion_pytorch_model.safetensors"
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2])
    assert "not a readable part" in problem()
    file.write_bytes(pickle.dumps(Harmful(tmp_path / "harm")))
    assert "not a readable part" in problem()
    file.unlink()
    file.with_suffix(".bin").write_bytes(pickle.dumps(Harmful(tmp_path / "harm")))
    with pytest.raises(WeightsMissing):
        make_editor(Edit(editor=editor), capture, 0)
    assert not (tmp_path / "harm").exists()


@pytest.mark.slow
def test_another_network_in_the_place_of_the_editor_is_named(weights, capture):
    shutil.rmtree(weights / "instruct-pix2pix/unet")
    shutil.copytree(weights / "stable-diffusion-v1-5/unet", weights / "instruct-pix2pix/unet")
    with pytest.raises(InputError, match=r"in_channels: 4 channels, of which an editor needs 8: it is another network"):
        make_editor(Edit(editor="instruct_pix2pix"), capture, 0)
    shutil.rmtree(weights / "control_v11e_sd15_ip2p")
    write_controlnet(weights / "control_v11e_sd15_ip2p", cross_attention_dim=32)
    with pytest.raises(InputError, match=r"cross_attention_dim: 32, that of Stable Diffusion 1\.5 is 16"):
        make_editor(Edit(editor="controlnet_ip2p"), capture, 0)


@pytest.mark.slow
def test_a_configuration_runs_no_code_of_its_folder(weights, capture, tmp_path):
    file = weights / "instruct-pix2pix/unet/config.json"
    content = json.loads(file.read_text())
    (weights / "instruct-pix2pix/unet/evil.py").write_text(f"open({str(tmp_path / 'harm')!r}, 'w')")
    file.write_text(json.dumps({**content, "_class_name": "evil.Net", "auto_map": {"AutoModel": "evil.Net"}}))
    make_editor(Edit(editor="instruct_pix2pix"), capture, 0)
    assert not (tmp_path / "harm").exists()
