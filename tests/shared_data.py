"""Where the shared meshes and head models are: the folder CARIGS_DATA. Tests that need it are skipped without it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

DATA = Path(os.environ["CARIGS_DATA"]) if os.environ.get("CARIGS_DATA") else None
needs_data = pytest.mark.skipif(DATA is None, reason="set CARIGS_DATA to the folder with the shared meshes")
