"""Stages `capture`, `exaggerate`, `gtstar` and `truth` on the miniature subject."""

import json
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from miniature import write_ball

from carigs.capture import Capture, look_at
from carigs.capture.images import read_bits, read_rgb, write_png
from carigs.errors import CarigsWarning, InputError, MeshError, SettingsError
from carigs.exaggeration import GammaPath
from carigs.gtstar import MaskFlag, capture_shading, frame_views, provider
from carigs.gtstar.provider import frame_weight
from carigs.gtstar.registration import RegistrationError
from carigs.head import neutral
from carigs.settings import CaptureSettings, Exaggerate, Gtstar, Truth
from carigs.stages.capture import capture
from carigs.stages.exaggerate import exaggerate
from carigs.stages.gtstar import gtstar
from carigs.stages.truth import truth

pytestmark = pytest.mark.filterwarnings("ignore::carigs.errors.CarigsWarning")
"""One test says which frames a warning counts; the others spoil frames, too."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Holds the ball, its `capture.json`, and a `path.npz` whose level 0.25 stretches it sideways."""
    folder = tmp_path_factory.mktemp("subject")
    write_ball(folder / "ball")
    settings = CaptureSettings(
        source="folder", folder=str(folder / "ball"), head_model=str(folder / "ball/head_model.npz")
    )
    capture(settings, index=folder / "capture.json", dataset=folder / "dataset")
    subject = Capture.load(folder / "capture.json")
    np.savez(folder / "level=0.25.npz", delta=neutral(subject.model, subject.parameters(0)) * [0.3, 0, 0])
    settings = Exaggerate(file=str(folder / "level={gamma}.npz"))
    exaggerate(settings, capture=folder / "capture.json", path=folder / "path.npz")
    return folder


def test_a_given_caricature_is_the_end_of_a_straight_path(folder):
    path = GammaPath.load(folder / "path.npz")
    delta = np.load(folder / "level=0.25.npz")["delta"]
    assert path.gamma_f == 0.25
    assert not path.displacement(0).any()
    np.testing.assert_allclose(path.displacement(0.25), delta, atol=1e-7)
    np.testing.assert_allclose(path.displacement(0.1), 0.4 * delta, atol=1e-7)


@pytest.mark.filterwarnings("default::carigs.errors.CarigsWarning")
def test_a_caricature_that_folds_is_warned_of_and_one_in_another_unit_is_refused(folder, tmp_path):
    """A ball pushed through its middle in x is inside out; one of thousands of diagonals is in millimetres."""
    subject = Capture.load(folder / "capture.json")
    vertices = neutral(subject.model, subject.parameters(0))
    arguments = {"capture": folder / "capture.json", "path": tmp_path / "path.npz"}
    settings = Exaggerate(file=str(tmp_path / "sculpt.npz"))
    np.savez(tmp_path / "sculpt.npz", delta=vertices * [-2, 0, 0])
    with pytest.warns(CarigsWarning, match=r"^level 0\.25: the surface folds: .* of the faces turn over"):
        exaggerate(settings, **arguments)
    np.savez(tmp_path / "sculpt.npz", delta=999 * vertices)
    with pytest.raises(MeshError, match=r"^level 0\.25: vertex \d+ moves by"):
        exaggerate(settings, **arguments)


def test_a_solved_caricature_carries_the_expressions_of_the_capture(folder, tmp_path):
    """jawOpen, the only one in use, is changed as told; what is not told is natural."""
    arguments = {"capture": folder / "capture.json", "path": tmp_path / "path.npz"}
    exaggerate(Exaggerate(limit_cavities=False, blendshape_transfer="linear"), **arguments)
    caricature = GammaPath.load(tmp_path / "path.npz").at(0.25)
    np.testing.assert_array_equal(caricature.columns, [0])
    opened = Capture.load(folder / "capture.json").model.shapedirs[:, :, 300]
    assert np.abs(caricature.changes).max() > 0.01 * np.abs(opened).max()
    exaggerate(Exaggerate(limit_cavities=False, blendshape_transfer="offset"), **arguments)
    assert GammaPath.load(tmp_path / "path.npz").changes is None
    assert GammaPath.load(folder / "path.npz").changes is None  # a sculpt


@pytest.mark.parametrize(
    ("file", "says"),
    [
        ("none.npz", "none.npz: no such caricature"),
        ("capture.json", "capture.json: unknown kind of mesh"),
        ("short.npz", "delta: shape"),
    ],
)
def test_a_caricature_that_does_not_fit_is_named(folder, file, says):
    np.savez(folder / "short.npz", delta=np.zeros((3, 3)))
    with pytest.raises(InputError, match=says):
        exaggerate(Exaggerate(file=str(folder / file)), capture=folder / "capture.json", path=folder / "x.npz")
    assert not (folder / "x.npz").exists()


def make_targets(
    subject: Path, out: Path, /, level: float = 0.25, key: str = "key", threads: int = 2, **changes
) -> dict:
    gtstar(
        Gtstar(**changes), capture=subject / "capture.json", path=subject / "path.npz", level=level,
        targets=out / "targets", index=out / "targets.json", resume_key=key,
        threads=threads,
    )  # fmt: skip
    return json.loads((out / "targets.json").read_text())


def test_targets_exist_for_training_frames_alone(folder, tmp_path):
    index = make_targets(folder, tmp_path)
    subject = Capture.load(folder / "capture.json")
    assert (index["level"], index["folder"]) == (0.25, "targets")
    assert index["left_out"] == []
    assert [(e["timestep"], e["camera"]) for e in index["targets"]] == [
        (f.timestep, f.camera) for f in subject.split("train")
    ]
    face_flags = np.load(tmp_path / "targets/faces.npy")
    np.testing.assert_array_equal(face_flags == MaskFlag.HAIR.value, subject.model.face_region("scalp"))
    for entry in index["targets"]:
        target = read_rgb(tmp_path / "targets" / entry["image"])
        mask_flags = read_bits(tmp_path / "targets" / entry["mask_flags"])
        assert target.shape == (*mask_flags.shape, 3) == (48, 40, 3)
        for flag in MaskFlag:
            share = float(((mask_flags & flag.value) > 0).mean())
            assert entry["shares"][flag.name.lower()] == pytest.approx(share, abs=1e-6)


@pytest.mark.slow
def test_the_light_is_written_for_training_only_if_surfels_follow_it(folder, tmp_path):
    for relight in ("none", "targets", "targets_and_surfels"):
        make_targets(folder, tmp_path / relight, relight=relight)
        assert (tmp_path / relight / "targets/shading.npz").is_file() == (relight == "targets_and_surfels")


def test_each_frame_is_decoded_and_rasterized_once(folder, tmp_path, monkeypatch):
    """Once at either end of the warp, although the light is fitted to the same frames; the cache changes nothing."""
    calls = Counter()

    def count(module, name):
        original = getattr(module, name)

        def counted(*arguments):
            calls[module, name] += 1
            return original(*arguments)

        monkeypatch.setattr(module, name, counted)

    for name in ("_read_images", "compute_visibility"):
        count(frame_views, name)
    count(provider, "compute_visibility")
    make_targets(folder, tmp_path / "cached", threads=1)
    assert list(calls.values()) == [6, 6, 6]
    monkeypatch.setattr(capture_shading, "CACHE_BYTES", 0)
    make_targets(folder, tmp_path / "loaded", threads=1)
    assert calls[frame_views, "_read_images"] == 3 * 6
    assert contents(tmp_path / "cached") == contents(tmp_path / "loaded")


@pytest.fixture
def damaged(folder, tmp_path) -> Path:
    """A copy whose frames can be spoilt."""
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    return copy


def test_unusable_frames_are_skipped_and_counted(damaged, tmp_path, capsys):
    images, masks = damaged / "ball/images", damaged / "ball/fg_masks"
    (images / "00000_00.png").write_bytes((images / "00000_00.png").read_bytes()[:60])
    write_png(masks / "00000_02.png", np.ones((20, 40)))
    (masks / "00001_00.png").unlink()
    with pytest.warns(CarigsWarning, match="3 of 6 frames have no targets: .*not a readable image"):
        index = make_targets(damaged, tmp_path)
    assert [(e["timestep"], e["camera"]) for e in index["left_out"]] == [(0, 0), (0, 2), (1, 0)]
    for entry, word in zip(
        index["left_out"], ("not a readable image", "its camera has 40 x 48", "no such"), strict=True
    ):
        assert word in entry["why"]
    assert "is skipped" in capsys.readouterr().out
    assert len(index["targets"]) == 3


KILLED = """
import os, signal, sys
from pathlib import Path
from carigs.capture.images import write_png
from carigs.settings import Gtstar
from carigs.gtstar import target_set
from carigs.stages import gtstar as stage
write_all = target_set._write
def write(folder, results):
    if len(list(folder.glob("*_mask_flags.png"))) < 2:
        return write_all(folder, results)
    (folder / f"{results[0].frame.name}.png").write_bytes(b"half of an ima")
    os.kill(os.getpid(), signal.SIGKILL)
target_set._write = write
subject, out = map(Path, sys.argv[1:])
files = {"capture": subject / "capture.json", "path": subject / "path.npz"}
outputs = {"targets": out / "targets", "index": out / "targets.json"}
stage.gtstar(Gtstar(), **files, level=0.25, **outputs, resume_key="key")
"""


@pytest.fixture(scope="module")
def killed(folder, tmp_path_factory) -> Path:
    """What a run leaves behind that was killed while it wrote its second timestep."""
    out = tmp_path_factory.mktemp("killed")
    run = subprocess.run([sys.executable, "-c", KILLED, str(folder), str(out)], capture_output=True, check=False)
    assert run.returncode == -9, run.stderr.decode()
    assert not (out / "targets").exists() and not (out / "targets.json").exists()
    return out


def contents(out: Path) -> dict[str, bytes]:
    return {file.relative_to(out).as_posix(): file.read_bytes() for file in out.rglob("*") if file.is_file()}


@pytest.mark.slow
def test_a_killed_run_is_resumed_to_the_same_bytes_on_any_number_of_threads(folder, killed, tmp_path, capsys):
    shutil.copytree(killed, tmp_path / "again")
    make_targets(folder, tmp_path / "again", threads=2)
    assert "2 of 6 frames were made by an earlier run" in capsys.readouterr().out
    make_targets(folder, tmp_path / "whole", threads=1)
    make_targets(folder, tmp_path / "wide", threads=3)
    whole = contents(tmp_path / "whole")
    assert len(whole) > 2 * 6
    assert contents(tmp_path / "again") == contents(tmp_path / "wide") == whole


@pytest.mark.slow
def test_an_interrupted_run_with_another_key_is_not_resumed(folder, killed, tmp_path, capsys):
    shutil.copytree(killed, tmp_path / "again")
    make_targets(folder, tmp_path / "again", key="another", supersampling=1)
    make_targets(folder, tmp_path / "whole", supersampling=1)
    assert contents(tmp_path / "again") == contents(tmp_path / "whole")
    assert "earlier run" not in capsys.readouterr().out


def test_a_failed_run_keeps_what_was_there(folder, tmp_path):
    make_targets(folder, tmp_path)
    before = contents(tmp_path)
    edited = tmp_path.with_name(f"{tmp_path.name}_none")
    edited.mkdir()
    with pytest.raises(InputError, match="no frame can be used"):
        make_targets(folder, tmp_path, provider="precomputed", folder=str(edited))
    assert {name: data for name, data in contents(tmp_path).items() if ".targets.part" not in name} == before


def test_frames_with_a_registration_error_have_less_weight_or_none():
    settings = Gtstar(registration_error_limit=1.5)
    weights = [frame_weight(RegistrationError(pixels, 0.0), settings) for pixels in (0.0, 0.5, 0.75, 1.0, 1.5)]
    np.testing.assert_allclose(weights, [1, 1, 0.75, 0.5, 0])
    assert frame_weight(None, settings) == 1


def test_the_index_holds_the_weight_of_a_shifted_frame(folder, tmp_path, capsys, monkeypatch):
    """The others have weight 1, and one that is too far off is skipped."""
    errors = {"00000_02": 0.8, "00001_00": 1.6}

    def measured(views, vertices, faces):
        return {frame: RegistrationError(errors[frame.name], 0.0) for frame in views if frame.name in errors}

    monkeypatch.setattr("carigs.gtstar.provider.registration_errors", measured)
    index = make_targets(folder, tmp_path)
    weights = {(entry["timestep"], entry["camera"]): entry["weight"] for entry in index["targets"]}
    assert weights == {(0, 0): 1, (0, 2): 0.7, (1, 2): 1, (2, 0): 1, (2, 2): 1}
    assert [entry["pixels_off"] for entry in index["left_out"]] == [1.6]
    said = capsys.readouterr().out
    assert "frame 00000_02 is 0.8 pixels off" in said and "frame 00001_00 is skipped" in said


@pytest.mark.parametrize("centre", [(0.0, 0.0, 0.0), (0.0, 0.05, 1.0)])
def test_a_camera_inside_the_head_or_with_the_head_behind_it_sees_no_target(damaged, tmp_path, centre):
    file = damaged / "capture.json"
    content = json.loads(file.read_text())
    away = look_at(np.array(centre), np.array(centre) + np.array([0, 0, 1.0]))
    for camera in content["cameras"]:
        camera["camera_from_world"] = away.tolist()
    file.write_text(json.dumps(content))
    with pytest.raises(InputError, match=r"no frame can be used; .*behind it or inside"):
        make_targets(damaged, tmp_path, relight="none")
    assert not (tmp_path / "targets").exists()


def test_identity_takes_the_frame_as_the_caricature(folder, tmp_path):
    index = make_targets(folder, tmp_path, provider="identity", supersampling=1)
    subject = Capture.load(folder / "capture.json")
    frame = subject.split("train")[0]
    target = read_rgb(tmp_path / "targets" / index["targets"][0]["image"])
    mask_flags = read_bits(tmp_path / "targets" / index["targets"][0]["mask_flags"])
    sampled = (mask_flags == 0) & (subject.mask(frame) > 0)
    assert sampled.sum() > 200
    np.testing.assert_allclose(target[sampled], subject.image(frame)[sampled], atol=0.5 / 255 + 1e-6)


def test_edited_frames_come_from_a_folder(folder, tmp_path):
    subject = Capture.load(folder / "capture.json")
    edited = tmp_path / "edited"
    edited.mkdir()
    for frame in subject.split("train")[:-1]:
        write_png(edited / f"{frame.name}.png", np.full((48, 40, 3), 0.4))
    index = make_targets(folder, tmp_path, provider="precomputed", folder=str(edited))
    assert len(index["targets"]) == len(subject.split("train")) - 1
    assert "no such image" in index["left_out"][0]["why"]
    mask_flags = read_bits(tmp_path / "targets" / index["targets"][0]["mask_flags"])
    target = read_rgb(tmp_path / "targets" / index["targets"][0]["image"])
    trusted = np.rint(255 * target[mask_flags == 0])
    assert np.isin(trusted, (102, 255)).all()
    assert (trusted == 102).sum() > 200
    with pytest.raises(SettingsError, match=r"gtstar\.folder must be set"):
        make_targets(folder, tmp_path, provider="precomputed")


@pytest.mark.parametrize("change", [{"provider": "magic"}, {"relight": "sun"}, {"warp": "cubic"}, {"supersampling": 9}])
def test_settings_without_meaning_are_refused_before_work(folder, tmp_path, change):
    with pytest.raises(SettingsError, match=f"gtstar.{next(iter(change))}="):
        make_targets(folder, tmp_path, **change)


def test_truth_at_level_zero_is_the_capture(folder, tmp_path):
    truth(
        Truth(), capture=folder / "capture.json", path=folder / "path.npz", level=0.0,
        frames=tmp_path / "frames", index=tmp_path / "truth.json",
    )  # fmt: skip
    subject = Capture.load(folder / "capture.json")
    index = json.loads((tmp_path / "truth.json").read_text())
    assert index["reason"] is None
    assert len(index["frames"]) == 6  # three test views, three timesteps of the validation view
    frame = subject.split("test")[0]
    np.testing.assert_array_equal(read_rgb(tmp_path / "frames" / f"{frame.name}.png"), subject.image(frame))


def test_a_real_person_has_no_true_caricature(folder, tmp_path):
    truth(
        Truth(), capture=folder / "capture.json", path=folder / "path.npz", level=0.1,
        frames=tmp_path / "frames", index=tmp_path / "truth.json",
    )  # fmt: skip
    index = json.loads((tmp_path / "truth.json").read_text())
    assert index["frames"] == []
    assert "no true caricature" in index["reason"]


def test_a_given_truth_is_checked_and_copied(folder, tmp_path):
    given = tmp_path / "level=0.1"
    given.mkdir()
    write_png(given / "a.png", np.full((48, 40, 3), 0.2))
    write_png(given / "m.png", np.ones((48, 40)))
    listing = [{"timestep_index": 3, "camera_index": 1, "file_path": "a.png", "fg_mask_path": "m.png"}]
    (given / "frames.json").write_text(json.dumps(listing))
    arguments = dict(
        capture=folder / "capture.json", path=folder / "path.npz", level=0.1,
        frames=tmp_path / "frames", index=tmp_path / "truth.json",
    )  # fmt: skip
    settings = Truth(folder=str(tmp_path / "level={level}"))
    truth(settings, **arguments)
    np.testing.assert_allclose(read_rgb(tmp_path / "frames/00003_01.png"), 0.2, atol=1e-6)

    write_png(given / "a.png", np.full((20, 40, 3), 0.2))
    with pytest.raises(InputError, match=r"a.png: its camera has 40 x 48 pixels"):
        truth(settings, **arguments)
    np.testing.assert_allclose(read_rgb(tmp_path / "frames/00003_01.png"), 0.2, atol=1e-6)  # nothing earlier is lost


@pytest.mark.parametrize(
    ("stage", "settings"),
    [(capture, lambda: CaptureSettings(source="tape")), (exaggerate, lambda: Exaggerate(region_constraint="magic"))],
)
def test_unknown_sources_are_refused(folder, tmp_path, stage, settings):
    outputs = {
        capture: {"index": tmp_path / "c.json", "dataset": tmp_path / "d"},
        exaggerate: {"capture": folder / "capture.json", "path": tmp_path / "p.npz"},
    }[stage]
    with pytest.raises(SettingsError, match="is unknown; choose"):
        stage(settings(), **outputs)
    assert not any(tmp_path.iterdir())
