"""The miniature bust with a region `nose`, its views, and where weights are looked for."""

import shutil

import pytest
from miniature import bust_cameras, bust_with_nose, write_ball

from carigs.capture import Capture, read_dataset
from carigs.editing.view import ViewToEdit
from carigs.head import pose


@pytest.fixture(scope="session")
def capture(tmp_path_factory) -> Capture:
    folder = write_ball(tmp_path_factory.mktemp("bust") / "bust", model=bust_with_nose(), cameras=bust_cameras())
    return read_dataset(folder, folder / "head_model.npz")


@pytest.fixture
def view(capture):
    """Makes the view of a training frame."""

    def make(index: int = 0, rendered=None, seed=(0,)) -> ViewToEdit:
        frame = capture.split("train")[index]
        image = capture.image(frame)
        vertices = pose(capture.model, capture.parameters(frame.timestep))
        return ViewToEdit(frame, image, image if rendered is None else rendered, capture.camera(frame), vertices, seed)

    return make


@pytest.fixture
def no_weights(tmp_path, monkeypatch):
    """A folder for weights that is empty, and no other place."""
    for name in ("HF_HOME", "TORCH_HOME"):
        monkeypatch.setenv(name, str(tmp_path / name))
    monkeypatch.delenv("HF_HUB_CACHE", raising=False)
    monkeypatch.setenv("CARIGS_WEIGHTS", str(tmp_path / "weights"))
    return tmp_path / "weights"


@pytest.fixture
def weights(models, no_weights, monkeypatch):
    """A copy of the tiny models of a module in this folder."""
    monkeypatch.setattr("carigs.weights.search.verify", lambda *_: "")  # sizes and checksums are those of real weights
    return shutil.copytree(models, no_weights)
