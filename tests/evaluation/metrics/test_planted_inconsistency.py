"""Views that are edited each on its own: metrics of agreement order editors by the inconsistency that is planted."""

from dataclasses import replace

import numpy as np
import pytest
from miniature import bust_cameras, bust_with_nose, write_ball

from carigs.capture import read_dataset
from carigs.capture.frame_index import RenderedImage
from carigs.capture.images import write_png
from carigs.capture.orbit import orbit_cameras
from carigs.editing.drawn_nose import DrawnNose
from carigs.editing.view import ViewToEdit
from carigs.exaggeration import Caricature
from carigs.head import neutral
from evaluation.metrics.frame_views import FrameView, PosedMesh
from evaluation.metrics.photo_consistency import consistency_records, flicker_records
from evaluation.metrics.regions import surface_regions
from evaluation.tables.metric_records import StudyPoint

DRIFTS = (0.0, 2.0, 5.0)
POINT = StudyPoint("s", "bust", "v", 0, 0.25, 0.0, "files")


@pytest.fixture(scope="module")
def bust(tmp_path_factory):
    folder = write_ball(tmp_path_factory.mktemp("bust") / "bust", model=bust_with_nose(), cameras=bust_cameras())
    return read_dataset(folder, folder / "head_model.npz")


def painted(head, visibility):
    """A Lambertian image: colours that are fixed to the surface, with details of a few pixels."""
    fragments = visibility.fragments
    points = np.einsum("hwc,hwck->hwk", fragments.barycentric, head.natural[visibility.faces[fragments.face]])
    colours = 0.5 + 0.4 * np.sin(points @ np.array([[260, 120, 50], [110, 270, -130], [40, -20, 50]]))
    return np.where(fragments.face[..., None] >= 0, colours, 1.0).astype(np.float32)


def edited_views(bust, cameras, protocol, drift, folder):
    """Views of one timestep that an editor with a drift has changed; None: as they are."""
    head = PosedMesh(bust, 0, Caricature(np.zeros_like(bust.model.v_template)))
    editor = None if drift is None else DrawnNose(bust.model, drift)
    views = []
    for number, camera in enumerate(cameras):
        image = painted(head, head.seen_by(camera))
        if editor is not None:
            frame = replace(bust.frames[0], camera=number)
            image = editor(ViewToEdit(frame, image, image, camera, head.natural, (0,)))
        file = folder / f"{protocol}_{drift}_{number}.png"
        write_png(file, image)
        views.append(
            FrameView(RenderedImage(protocol, 0, number, number, file, camera), camera, head, None, None, None)
        )
    return views


def means(bust, drift, folder):
    """Photo-consistency of neighbouring cameras, and flicker of an orbit, in the face."""
    surface = surface_regions(bust.model, neutral(bust.model, bust.parameters(0)))
    test = [camera.scaled(3) for camera in bust_cameras().values()]
    orbit = [camera.scaled(3) for camera in orbit_cameras(bust, 12, 60)]
    records = {
        "consistency": consistency_records(POINT, edited_views(bust, test, "test", drift, folder), surface),
        "flicker": flicker_records(POINT, iter(edited_views(bust, orbit, "orbit", drift, folder)), surface),
    }
    return {
        name: np.mean([record.value for record in found if record.region == "face" and record.value is not None])
        for name, found in records.items()
    }


@pytest.mark.slow
def test_photo_consistency_and_flicker_order_editors_by_their_inconsistency(bust, tmp_path):
    """And see that an edit in the image is no edit of the surface, even where the noses lie on each other."""
    unedited, *edited = (means(bust, drift, tmp_path) for drift in (None, *DRIFTS))
    for metric in ("consistency", "flicker"):
        values = [unedited[metric], *(found[metric] for found in edited)]
        assert (np.diff(values) > 0.05 * np.array(values[:-1])).all(), values
