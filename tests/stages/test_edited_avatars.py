"""Stages `train`, `render` and `metrics` of an avatar whose frames are edited: its mesh is not exaggerated."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from miniature import bust_cameras, bust_with_nose, write_ball

from carigs.capture import Capture, read_dataset
from carigs.capture.frame_index import read_frame_index
from carigs.errors import SettingsError
from carigs.exaggeration import straight_path
from carigs.head import neutral
from carigs.settings import Edit, Metrics, Render, Train, Truth
from carigs.splat.avatar import load_avatar
from carigs.stages.metrics import metrics
from carigs.stages.render import render
from carigs.stages.train import train
from carigs.stages.truth import truth

SETTINGS = Train(
    iterations=30, gtstar_probability=0, relight_surfels=False, edit=Edit(editor="drawn_nose", every=2), mouth_surfels=0
)
pytestmark = pytest.mark.filterwarnings("ignore::carigs.errors.CarigsWarning")


@pytest.fixture(scope="module")
def bust(tmp_path_factory):
    """A folder with `capture.json` and a `path.npz` that widens the bust."""
    folder = tmp_path_factory.mktemp("bust")
    write_ball(folder / "bust", model=bust_with_nose(), cameras=bust_cameras())
    read_dataset(folder / "bust", folder / "bust/head_model.npz").save(folder / "capture.json")
    subject = Capture.load(folder / "capture.json")
    shape = neutral(subject.model, subject.parameters(0))
    straight_path(shape, subject.model.faces, shape * [0.3, 0, 0], 0.25).save(folder / "path.npz")
    return folder


def trained(bust, folder, **changes):
    train(
        replace(SETTINGS, **changes), capture=bust / "capture.json", path=bust / "path.npz", targets=None,
        avatar=folder / "avatar.npz", ply=folder / "avatar.ply", log=folder / "log.csv", resume_key="key",
    )  # fmt: skip
    return folder / "avatar.npz"


def rendered(bust, folder):
    render(
        Render(levels=(0.0, 0.25), orbit_frames=2), avatar=folder / "avatar.npz", capture=bust / "capture.json",
        path=bust / "path.npz", frames=folder / "frames", resume_key="key",
    )  # fmt: skip
    return {level: read_frame_index(folder / f"frames/level={level:g}/frames.json") for level in (0.0, 0.25)}


@pytest.mark.slow
def test_an_edited_avatar_looks_the_same_at_every_level(bust, tmp_path):
    assert load_avatar(trained(bust, tmp_path)).sequence.path.is_still
    shown = rendered(bust, tmp_path)
    test = {level: [f for f in frames if f.protocol == "test"] for level, frames in shown.items()}
    assert len(test[0.0]) == len(test[0.25]) > 0
    for natural, caricature in zip(*test.values(), strict=True):
        assert natural.file.read_bytes() == caricature.file.read_bytes()
    assert {frame.mesh_level for frames in shown.values() for frame in frames} == {0.0}


@pytest.mark.slow
def test_other_avatars_are_exaggerated_and_say_nothing_of_the_mesh(bust, tmp_path):
    assert not load_avatar(trained(bust, tmp_path, edit=Edit())).sequence.path.is_still
    shown = rendered(bust, tmp_path)
    assert {frame.mesh_level for frames in shown.values() for frame in frames} == {None}
    assert shown[0.0][0].file.read_bytes() != shown[0.25][0].file.read_bytes()


@pytest.mark.slow
def test_metrics_measure_it_on_the_mesh_that_it_has(bust, tmp_path):
    """Adherence, and photo-consistency by the depth of the mesh, are those of level 0."""
    trained(bust, tmp_path)
    rendered(bust, tmp_path)
    indexes = []
    for level in (0.0, 0.25):
        index = tmp_path / f"truth/level={level:g}/truth.json"
        truth(
            Truth(), capture=bust / "capture.json", path=bust / "path.npz", level=level,
            frames=index.parent / "frames", index=index,
        )  # fmt: skip
        indexes.append(index)
    metrics(
        Metrics(embeddings=(), lpips=()), frames=tmp_path / "frames", capture=bust / "capture.json",
        path=bust / "path.npz", truths=indexes, study="s", subject="bust", variant="drawn_nose", seed=0, gamma=0.25,
        levels=[0.0, 0.25], embeddings=str(tmp_path / "embeddings"), records=tmp_path / "metrics.csv",
    )  # fmt: skip
    records = pd.read_csv(tmp_path / "metrics.csv")
    for metric in ("photo_consistency_l1", "flicker_l1", "depth_error", "normal_error", "silhouette_iou"):
        by_level = [records[(records.metric == metric) & (records.level == level)].value for level in (0.0, 0.25)]
        assert by_level[0].notna().any()
        np.testing.assert_array_equal(*by_level)


def test_frames_are_edited_where_nothing_else_supervises(bust, tmp_path):
    with pytest.raises(SettingsError, match=r"drawn_nose edits real frames, which train\.gtstar_probability=0 takes"):
        train(
            replace(SETTINGS, gtstar_probability=0.5), capture=bust / "capture.json", path=bust / "path.npz",
            targets=[tmp_path / "targets.json"], avatar=tmp_path / "avatar.npz", ply=tmp_path / "avatar.ply",
            log=tmp_path / "log.csv", resume_key="key",
        )  # fmt: skip
    with pytest.raises(SettingsError, match="the head model has no region horns"):
        trained(bust, tmp_path, edit=Edit(editor="drawn_nose", regions=("horns",)))
    assert not [*tmp_path.iterdir()]
