"""Settings of a stage as its job reads them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from carigs.config import load_settings, settings_text


@pytest.fixture(autouse=True)
def data_folder(monkeypatch):
    """The subject `ict_s1` lies in the folder CARIGS_DATA; nothing is read from it here."""
    monkeypatch.setenv("CARIGS_DATA", "/data")


@pytest.fixture
def load(tmp_path) -> Callable[..., Any]:
    """Composes the section of a stage, writes it, and reads it."""

    def write_and_read(stage: str, *overrides: str):
        file = tmp_path / f"{stage}.yaml"
        file.write_text(settings_text(stage, *overrides))
        return load_settings(stage, file)

    return write_and_read
