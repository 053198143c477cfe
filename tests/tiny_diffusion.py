"""Tiny diffusion models with random weights, in the layout of diffusers."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch

SPECIAL = {"bos_token": "<|startoftext|>", "eos_token": "<|endoftext|>", "unk_token": "<|endoftext|>",
           "pad_token": "<|endoftext|>"}  # fmt: skip
UNET = dict(
    block_out_channels=(8, 16), layers_per_block=1, norm_num_groups=4, cross_attention_dim=16, attention_head_dim=4,
    down_block_types=("DownBlock2D", "CrossAttnDownBlock2D"),
)  # fmt: skip


def write_diffusion_model(folder: Path, in_channels: int = 4, sample_size: int = 64, **vae) -> Path:
    """Write all parts of a Stable Diffusion model.

    Args:
        folder: Folder to create.
        in_channels: Channels of the network: 4, or 8 of a model that edits images.
        sample_size: Height and width of its latents, an eighth of those of images.
        **vae: More of the configuration of the autoencoder.

    Returns:
        The folder.
    """
    diffusers, transformers = pytest.importorskip("diffusers"), pytest.importorskip("transformers")
    torch.manual_seed(0)
    diffusers.UNet2DConditionModel(
        sample_size=sample_size, in_channels=in_channels, up_block_types=("CrossAttnUpBlock2D", "UpBlock2D"), **UNET
    ).save_pretrained(folder / "unet")
    diffusers.AutoencoderKL(
        block_out_channels=(4, 4, 4, 8), norm_num_groups=2, down_block_types=("DownEncoderBlock2D",) * 4,
        up_block_types=("UpDecoderBlock2D",) * 4, **vae,
    ).save_pretrained(folder / "vae")  # fmt: skip
    words = {"<|startoftext|>": 0, "<|endoftext|>": 1, "n": 2, "o": 3, "n</w>": 4, "e</w>": 5, "s": 6, "s</w>": 7}
    transformers.CLIPTextModel(
        transformers.CLIPTextConfig(
            vocab_size=len(words), hidden_size=16, intermediate_size=16, num_hidden_layers=1, num_attention_heads=2,
            max_position_embeddings=7, bos_token_id=0, eos_token_id=1, pad_token_id=1,
        )
    ).save_pretrained(folder / "text_encoder")  # fmt: skip
    (folder / "tokenizer").mkdir()
    (folder / "tokenizer/vocab.json").write_text(json.dumps(words))
    (folder / "tokenizer/merges.txt").write_text("#version: 0.2\n")
    (folder / "tokenizer/special_tokens_map.json").write_text(json.dumps(SPECIAL))
    (folder / "tokenizer/tokenizer_config.json").write_text(json.dumps({"tokenizer_class": "CLIPTokenizer", **SPECIAL}))
    diffusers.PNDMScheduler(
        beta_schedule="scaled_linear", beta_start=0.00085, beta_end=0.012, skip_prk_steps=True
    ).save_pretrained(folder / "scheduler")
    return folder


def write_controlnet(folder: Path, **changes) -> Path:
    """Write a ControlNet for such a model.

    Args:
        folder: Folder to create.
        **changes: Changes of its configuration.

    Returns:
        The folder.
    """
    diffusers = pytest.importorskip("diffusers")
    torch.manual_seed(1)
    control = diffusers.ControlNetModel(conditioning_embedding_out_channels=(4, 4, 4, 8), **{**UNET, **changes})
    for parameter in control.parameters():  # its last layers start at zero: it would steer nothing
        torch.nn.init.normal_(parameter, std=0.1)
    control.save_pretrained(folder)
    return folder


def write_ip_adapter(folder: Path, unet: Path) -> Path:
    """Write an IP-Adapter and its image encoder for such a model.

    Args:
        folder: Folder to create.
        unet: Folder of the network that it is for.

    Returns:
        The folder.
    """
    diffusers, transformers = pytest.importorskip("diffusers"), pytest.importorskip("transformers")
    from safetensors.torch import save_file

    torch.manual_seed(2)
    width, dim = 24, UNET["cross_attention_dim"]
    transformers.CLIPVisionModelWithProjection(
        transformers.CLIPVisionConfig(
            hidden_size=16, intermediate_size=16, num_hidden_layers=1, num_attention_heads=2, image_size=32,
            patch_size=16, projection_dim=width,
        )
    ).save_pretrained(folder / "models/image_encoder")  # fmt: skip
    network = diffusers.UNet2DConditionModel.from_pretrained(unet, low_cpu_mem_usage=False)
    state = {"image_proj.proj.weight": torch.randn(4 * dim, width), "image_proj.proj.bias": torch.randn(4 * dim),
             "image_proj.norm.weight": torch.ones(dim), "image_proj.norm.bias": torch.zeros(dim)}  # fmt: skip
    crossed = [name for name in network.attn_processors if not name.endswith("attn1.processor")]
    for number, name in enumerate(crossed):
        layer = network.get_submodule(name.removesuffix(".processor"))
        for part in ("to_k", "to_v"):
            shape = getattr(layer, part).weight.shape
            state[f"ip_adapter.{2 * number + 1}.{part}_ip.weight"] = torch.randn(shape)
    save_file(state, folder / "models/ip-adapter_sd15.safetensors")
    return folder
