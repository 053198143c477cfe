"""Array shapes in signatures are checked while the tests run; property tests draw the same examples every time."""

from __future__ import annotations

import os
from pathlib import Path

import hypothesis
from jaxtyping import install_import_hook

os.environ.setdefault("MPLBACKEND", "Agg")
hypothesis.settings.register_profile("repeatable", derandomize=True, deadline=None, max_examples=50)
hypothesis.settings.load_profile("repeatable")

ROOT = Path(__file__).parents[1]


def checked_modules() -> list[str]:
    """Modules of ours, less those with Numba kernels: those cannot be compiled from a wrapped function."""
    modules = []
    for package in ("carigs", "evaluation"):
        for file in sorted((ROOT / package).rglob("*.py")):
            text = file.read_text("utf-8")
            if "numba" not in text and "carigs.simd" not in text:
                modules.append(".".join(file.relative_to(ROOT).with_suffix("").parts))
    return modules


install_import_hook(checked_modules(), "typecheck.typecheck")
