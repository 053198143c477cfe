"""The levels of caricature at which avatars are rendered and trained."""

from __future__ import annotations

from omegaconf import DictConfig


def rendered_levels(config: DictConfig) -> list[str]:
    """The levels at which an avatar is rendered: 0, gamma, and the study's levels between them.

    Args:
        config: Composed settings.

    Returns:
        Levels in ascending order, formatted as in paths.
    """
    inside = {level for level in config.study.levels if level < config.gamma}
    return list(dict.fromkeys(f"{level:g}" for level in sorted({0.0, *inside, config.gamma})))


def left_out_levels(config: DictConfig) -> list[str]:
    """The levels of a study that are not rendered, because they lie above gamma.

    Args:
        config: Composed settings.

    Returns:
        Levels in ascending order, formatted as in paths.
    """
    return [f"{level:g}" for level in sorted({*config.study.levels}) if level > config.gamma]


def target_levels(train: DictConfig, gamma: float) -> list[str]:
    """The levels whose GT* frames training reads: `train.num_gtstar_levels` of them, evenly spaced up to gamma.

    Args:
        train: Composed section `train`.
        gamma: The level that is trained for.

    Returns:
        Levels formatted as in paths. Without GT* supervision gamma alone, if the fitted light is used, or none.
    """
    if train.gtstar_probability == 0:
        return [f"{gamma:g}"] if train.relight_surfels else []
    return [f"{gamma * k / train.num_gtstar_levels:g}" for k in range(1, train.num_gtstar_levels + 1)]
