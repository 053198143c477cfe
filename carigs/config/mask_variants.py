"""Variants that differ from `alternating` in one mask flag: made from the list of flags, not read from `conf/`."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from carigs.settings import DEFAULT_MASK_FLAGS, MASK_FLAGS


def _with_flag(flag: str) -> str:
    return f"""# @package _global_
# `alternating` with the additional mask flag `{flag}`.
train:
  add_mask_flags: [{flag}]
"""


def _without_flag(flag: str) -> str:
    return f"""# @package _global_
# `alternating` without the mask flag `{flag}`.
train:
  remove_mask_flags: [{flag}]
"""


MASK_VARIANTS: Mapping[str, str] = MappingProxyType(
    {f"no_{flag}_mask": _without_flag(flag) for flag in DEFAULT_MASK_FLAGS}
    | {f"{flag}_mask": _with_flag(flag) for flag in MASK_FLAGS if flag not in DEFAULT_MASK_FLAGS}
)
"""By name the text that a file of `conf/variant` would have: `no_FLAG_mask` for a flag of the default, `FLAG_mask` for
another one."""


def mask_variant(name: str) -> str | None:
    """The text of a variant that is made from a mask flag.

    Args:
        name: Group and name of a choice: `variant/no_hair_mask`.

    Returns:
        Its text; None for any other choice.
    """
    group, _, variant = name.rpartition("/")
    return MASK_VARIANTS.get(variant) if group == "variant" else None
