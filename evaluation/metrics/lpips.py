"""LPIPS (Zhang et al. 2018) between an image and the true image, over the whole image or a region.

The networks and their learned weights per channel are those of torchmetrics; the convolutional trunks are torchvision's
and come from the registry of weights.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from carigs.errors import InputError, WeightsMissing
from carigs.readers.weights import read_weights
from carigs.settings import Metrics
from carigs.weights.registry import registered
from carigs.weights.search import find_weights
from evaluation.metrics.networks.device import set_up_torch

if TYPE_CHECKING:
    import torch

LPIPS_REGIONS = ("full", "head")
WEIGHTS = {"vgg": "vgg16_imagenet", "alex": "alexnet_imagenet"}
SMALLEST_IMAGE = 32
"""Pixels of the shorter side; the layers of AlexNet leave nothing of smaller images."""


class Convention(NamedTuple):
    """How a variant of LPIPS is computed."""

    trunk: str
    """`vgg` (VGG16) or `alex` (AlexNet)."""
    normalize: bool
    """Whether images in [0, 1] are scaled to [-1, 1], the range that the network was trained for."""


LPIPS_METRICS = {
    "lpips_vgg": Convention("vgg", normalize=True),
    "lpips_alex": Convention("alex", normalize=True),
    "lpips_alex_3dgs": Convention("alex", normalize=False),
}
"""`lpips_alex_3dgs` feeds [0, 1] as it is, as code that follows 3D Gaussian Splatting does: for comparison with
published tables only."""


def load_lpips(trunk: str, file: Path) -> torch.nn.Module:
    """Load an LPIPS network.

    Args:
        trunk: `vgg` or `alex`.
        file: Parameters of torchvision's network.

    Returns:
        torchmetrics' network, in evaluation mode.

    Raises:
        InputError: The weights do not fit the architecture.
    """
    from torchmetrics.functional.image.lpips import _NoTrainLpips  # its public classes download the trunk

    network, state = _NoTrainLpips(net=trunk, pnet_rand=True), read_weights(file)
    try:  # slice2.3.weight of torchmetrics is features.3.weight of torchvision
        layers = {name: state[f"features.{name.split('.', 1)[1]}"] for name in network.net.state_dict()}
        network.net.load_state_dict(layers)
    except (KeyError, RuntimeError) as error:
        problem = " ".join(str(error).split())[:120]
        raise InputError(f"these weights are not {registered(WEIGHTS[trunk]).title} ({problem})", file=file) from error
    return network


def lpips(
    network: torch.nn.Module,
    image: Float[np.ndarray, "h w 3"],
    truth: Float[np.ndarray, "h w 3"],
    regions: Mapping[str, Bool[np.ndarray, "h w"]],
    *,
    normalize: bool,
) -> dict[str, float]:
    """LPIPS over regions of an image.

        LPIPS = sum over layers l of the mean over the region of w_l . (f_l(image) - f_l(truth))^2

    with the features f_l, normalised at each position, and learned weights w_l. A position of a layer counts by the
    share of its pixels that lie in the region; over the whole image this is LPIPS as published. Features see some
    pixels around the region.

    Args:
        network: LPIPS network.
        image: Image with values in [0, 1].
        truth: True image.
        regions: Pixels of each region.
        normalize: Whether values are scaled to [-1, 1], as the network expects.

    Returns:
        Distance by region: 0 for equal images, nan for an empty region.
    """
    import torch
    from torch.nn.functional import adaptive_avg_pool2d

    device = next(network.parameters()).device
    maps = []
    hooks = [
        weighted.register_forward_hook(lambda _module, _inputs, output: maps.append(output.double()))
        for weighted in network.lins
    ]
    try:
        with torch.inference_mode():
            network(*(_batch(pixels).to(device) for pixels in (image, truth)), normalize=normalize)
    finally:
        for hook in hooks:
            hook.remove()
    distances = {}
    for name, region in regions.items():
        inside = torch.from_numpy(region).to(device)[None, None].double()
        shares = [adaptive_avg_pool2d(inside, layer.shape[2:]) for layer in maps]
        means = [(layer * share).sum() / share.sum() for layer, share in zip(maps, shares, strict=True)]
        distances[name] = float(sum(means))
    return distances


def load_lpips_metrics(settings: Metrics, threads: int = 1) -> tuple[dict[str, torch.nn.Module], dict[str, str]]:
    """Load the networks of `settings.lpips`; libraries are imported only once weights are found.

    Args:
        settings: Settings of the stage `metrics`.
        threads: Threads of the networks; the result does not depend on it.

    Returns:
        The network of each metric, and the reason for each metric without one.

    Raises:
        WeightsMissing: Weights are missing and `settings.strict` is set.
        InputError: The weights are not those of the registry.
    """
    networks, reasons = {}, {}
    for metric in settings.lpips:
        trunk = LPIPS_METRICS[metric].trunk
        shared = next((name for name in networks if LPIPS_METRICS[name].trunk == trunk), None)
        if shared:
            networks[metric] = networks[shared]
            continue
        try:
            file = find_weights(registered(WEIGHTS[trunk]), settings.weights)
        except WeightsMissing as error:
            if settings.strict:
                raise
            reasons[metric] = str(error)
        else:
            networks[metric] = load_lpips(trunk, file).to(set_up_torch(threads))
    return networks, reasons


def _batch(image: Float[np.ndarray, "h w 3"]) -> torch.Tensor:
    import torch

    return torch.from_numpy(np.array(image, np.float32)).permute(2, 0, 1)[None]
