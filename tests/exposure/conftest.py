"""A small procedural capture whose cameras have one exposure."""

from __future__ import annotations

import pytest

from carigs.capture import Capture, read_dataset
from carigs.exposure import measure_exposures
from carigs.settings import Toy
from carigs.toy import write_capture


@pytest.fixture(scope="session")
def sound(tmp_path_factory) -> Capture:
    folder = tmp_path_factory.mktemp("sound")
    size = {"width": 104, "height": 136, "cameras": 5, "steps_per_sequence": 1, "texture_size": 256}
    write_capture(folder, Toy(**size, supersampling=1, hair_strands=300))
    return read_dataset(folder, folder / "head_model.npz")


@pytest.fixture(scope="session")
def found(sound):
    """What is measured of it."""
    return measure_exposures(sound)
