"""Settings of the editing of an avatar by text."""

from __future__ import annotations

from dataclasses import dataclass

from carigs.settings.option import MAX_COUNT, Section, option

EDITORS = ("none", "instruct_pix2pix", "controlnet_ip2p", "drawn_nose", "drawn_nose_2px", "drawn_nose_5px")


@dataclass
class Edit(Section, key="train.edit"):
    """Edits of the frames while the avatar is trained, by text: iterative dataset update.

    Defaults are those of Instruct-NeRF2NeRF (Haque et al. 2023), which GaussianEditor (Chen et al. 2024) shares.
    """

    editor: str = option("none", choices=EDITORS)
    """What edits the frames. `instruct_pix2pix`: the network of Brooks et al. 2023. `controlnet_ip2p`: Stable Diffusion
    with ControlNet's network for instructions, as in the paper. `drawn_nose`: a nose that is enlarged in the image,
    without networks; `drawn_nose_2px` and `_5px` move it in every view by as much, each in another direction."""
    prompt: str = "Turn him into a realistic caricature."
    """What is asked of the networks: the first of the paper's two; the second is "Make his nose bigger"."""
    regions: tuple[str, ...] = ()
    """Regions of the head model, such as `nose`, to which edits are confined: other pixels keep the frame, and surfels
    on other triangles stay as they are; empty: everywhere."""
    every: int = option(10, ge=1, le=MAX_COUNT)
    """Steps between two edits, of one frame each."""
    text_guidance: float = option(7.5, ge=0, le=100)
    """Scale of the guidance by the prompt."""
    image_guidance: float = option(1.5, ge=0, le=100)
    """Scale of the guidance by the captured frame; `controlnet_ip2p` has none."""
    noise: float = option(0.98, gt=0.02, le=0.98)
    """Noise that is added to the rendered image, at most: each edit draws its time between 0.02 and this of the whole
    schedule. A small value keeps the edit near what is rendered."""
    steps: int = option(20, ge=1, le=1000)
    """Steps of the sampler (DDIM) that remove the noise."""
