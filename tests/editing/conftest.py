"""The miniature bust with a region `nose`, and its views."""

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
