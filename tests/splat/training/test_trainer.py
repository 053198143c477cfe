"""Training on the miniature subject: schedule, Adam, freezing, resuming, reproducibility."""

import json
from dataclasses import replace
from itertools import cycle

import numba
import numpy as np
import pytest
import torch
from miniature import write_ball

from carigs.capture import read_dataset
from carigs.capture.images import write_bits, write_png
from carigs.capture.target_index import read_targets
from carigs.errors import InputError, SettingsError
from carigs.exaggeration.gamma_path import straight_path
from carigs.gtstar import MaskFlag
from carigs.head import neutral
from carigs.settings import DEFAULT_MASK_FLAGS, Density, Train
from carigs.splat.avatar import Avatar, load_avatar, save_avatar
from carigs.splat.rig.head_sequence import head_sequence
from carigs.splat.surfels.surfels import to_arrays
from carigs.splat.training import numba_step, trainer
from carigs.splat.training.adam import Adam
from carigs.splat.training.budget import with_iterations
from carigs.splat.training.checkpoint import Checkpoint
from carigs.splat.training.initial_surfels import initialization
from carigs.splat.training.photometric_loss import photometric_loss
from carigs.splat.training.schedule import draw_schedule
from carigs.splat.training.subject import TrainingSubject
from carigs.splat.training.supervision import Supervision
from carigs.splat.training.trainer import learning_rates, train_surfels
from carigs.splat.training.training_step import SSIM_WEIGHT

LEVELS = (0.1, 0.25)
SETTINGS = Train(
    iterations=30,
    hair_layers=2,
    density=Density(start=10, stop=28, every=6, gradient_threshold=1e-5, max_surfels=2200),
)


@pytest.fixture(autouse=True)
def more_rows(monkeypatch):
    """A row of the log for each five steps."""
    monkeypatch.setattr(trainer, "LOG_EVERY", 5)


@pytest.fixture(scope="module")
def subject(tmp_path_factory):
    """The ball, a caricature of it that is wider, and targets whose scalp is masked."""
    folder = tmp_path_factory.mktemp("ball")
    write_ball(folder)
    capture = read_dataset(folder, folder / "head_model.npz")
    rest = neutral(capture.model, capture.parameters(0))
    path = straight_path(rest, capture.model.faces, rest * [0.3, 0, 0], 0.25)
    return capture, head_sequence(capture, path), {level: write_targets(folder, capture, level) for level in LEVELS}


def write_targets(folder, capture, level):
    """Mirrored frames, the darker the higher the level, whose upper part is masked; returns their index."""
    images = folder / f"level={level}"
    images.mkdir()
    entries = []
    for frame in capture.split("train"):
        names = {"image": f"{frame.name}.png", "mask_flags": f"{frame.name}_mask_flags.png"}
        write_png(images / names["image"], (1 - level) * capture.image(frame)[:, ::-1])
        mask_flags = np.zeros(capture.mask(frame).shape, np.uint16)
        mask_flags[:12] = MaskFlag.HAIR.value
        write_bits(images / names["mask_flags"], mask_flags)
        entries.append({"timestep": frame.timestep, "camera": frame.camera, **names})
    np.save(
        images / "faces.npy", np.where(capture.model.face_region("scalp"), MaskFlag.HAIR.value, 0).astype(np.uint16)
    )
    index = folder / f"level={level}.json"
    index.write_text(json.dumps({"level": level, "folder": images.name, "targets": entries}))
    return index


def supervise(subject, *levels, mask_flags=DEFAULT_MASK_FLAGS):
    capture, _, indices = subject
    return Supervision(capture, [read_targets(indices[level], capture) for level in levels], mask_flags)


def run(subject, checkpoint, at=(0.25,), on_step=None, key="key", **changes):
    settings, sequence = replace(SETTINGS, **changes), subject[1]
    supervision = supervise(subject, *at, mask_flags=settings.mask_flags)
    return train_surfels(settings, TrainingSubject(sequence, supervision), Checkpoint(checkpoint, key), on_step)


def as_bytes(surfels):
    return b"".join(value.tobytes() for value in to_arrays(surfels).values())


def without_clock(rows):
    """The log without its column of seconds."""
    return [(row[0], *row[2:]) for row in rows]


def test_training_reduces_the_loss(subject, tmp_path, capsys):
    _, rows = run(subject, tmp_path / "c", gtstar_probability=0.0, iterations=60, initial_opacity=0.3)
    psnr = [row[4] for row in rows]
    assert psnr[-1] > psnr[0] + 2
    assert rows[-1][3] < 0.7 * rows[0][3]
    assert "train 60/60" in capsys.readouterr().err


@pytest.fixture(scope="module")
def start(subject, tmp_path_factory):
    """An avatar after 30 steps."""
    file = tmp_path_factory.mktemp("start") / "avatar.npz"
    surfels, _ = run(subject, file.with_suffix(".checkpoint"), gtstar_probability=0.0)
    save_avatar(file, Avatar(surfels, subject[1]))
    return file


@pytest.fixture
def images_alone(monkeypatch):
    """A loss of the images alone."""
    monkeypatch.setattr(numba_step, "POSITION_WEIGHT", 0.0)
    monkeypatch.setattr(numba_step, "SCALE_WEIGHT", 0.0)


@pytest.mark.usefixtures("images_alone")
@pytest.mark.parametrize("gtstar", [0.0, 1.0])
@pytest.mark.parametrize("degree", [0, 2])
def test_a_training_that_starts_from_an_avatar_begins_with_its_loss(subject, start, gtstar, degree, tmp_path):
    """Real frames and targets: the loss of the first step is that of the image that the avatar renders."""
    settings = {"start": str(start), "iterations": 1, "gtstar_probability": gtstar, "sh_degree": degree}
    _, ((_, _, caricature, loss, psnr, surfels),) = run(subject, tmp_path / "c", **settings)
    supervision, avatar = supervise(subject, 0.25), load_avatar(start)
    count = len(supervision.targets if gtstar else supervision.frames)
    schedule = draw_schedule(1, len(supervision.frames), len(supervision.targets), gtstar, SETTINGS.seed)
    example = supervision.example(bool(gtstar), int(schedule.index[0]) % count)
    image = avatar.render(example.timestep, example.level, example.camera)
    valid = None if example.valid is None else torch.from_numpy(example.valid)
    tensors = torch.from_numpy(image), torch.from_numpy(example.image)
    expected = example.weight * photometric_loss(*tensors, SSIM_WEIGHT, valid)
    assert (caricature, surfels) == (int(gtstar), len(avatar.surfels))
    assert loss == pytest.approx(float(expected), rel=1e-4)
    error = ((image - example.image) ** 2)[slice(None) if example.valid is None else example.valid]
    assert psnr == pytest.approx(-10 * np.log10(error.mean()), abs=0.01)


def test_an_avatar_of_another_head_or_with_more_harmonics_is_no_start(subject, start, tmp_path):
    with np.load(start) as arrays:
        changed = dict(arrays)
    np.savez(tmp_path / "turned.npz", **{**changed, "head_f": changed["head_f"][:, [1, 2, 0]]})
    with pytest.raises(InputError, match=r"turned\.npz: .*other triangles"):
        run(subject, tmp_path / "c", start=str(tmp_path / "turned.npz"))
    n = len(changed["surfel_binding"])
    np.savez(tmp_path / "lit.npz", **{**changed, "surfel_harmonics": np.ones((n, 3, 3), np.float32)})
    with pytest.raises(SettingsError, match=r"train\.sh_degree=0 is less than the 1"):
        run(subject, tmp_path / "c", start=str(tmp_path / "lit.npz"))


def test_equal_settings_give_equal_bytes_at_any_number_of_threads(subject, tmp_path):
    results, most = [], min(2, numba.config.NUMBA_NUM_THREADS)
    for threads in (1, most):
        numba.set_num_threads(threads)
        torch.set_num_threads(threads)
        results.append(run(subject, tmp_path / "c", sh_degree=1))
    turns = cycle((1, most))  # idle cores come and go
    results.append(run(subject, tmp_path / "c", on_step=lambda _: numba.set_num_threads(next(turns)), sh_degree=1))
    first, *others = results
    for surfels, rows in others:
        assert as_bytes(surfels) == as_bytes(first[0])
        assert without_clock(rows) == without_clock(first[1])


def test_a_killed_run_resumes_to_the_same_bytes(subject, tmp_path, monkeypatch):
    surfels, rows = run(subject, tmp_path / "none")
    assert len({row[5] for row in rows}) > 1  # density control was at work
    steps = 0
    photometric_loss = numba_step.photometric_loss

    def killed(*arguments):
        nonlocal steps
        steps += 1
        if steps == 18:
            raise KeyboardInterrupt
        return photometric_loss(*arguments)

    monkeypatch.setattr(numba_step, "photometric_loss", killed)
    monkeypatch.setattr(trainer, "CHECKPOINT_SECONDS", 0.0)
    with pytest.raises(KeyboardInterrupt):
        run(subject, tmp_path / "state")
    resumed, resumed_rows = run(subject, tmp_path / "state")
    assert steps < 18 + 15  # it did not start again
    assert as_bytes(resumed) == as_bytes(surfels)
    assert without_clock(resumed_rows) == without_clock(rows)


def test_a_run_within_a_budget_is_the_run_of_as_many_steps(subject, tmp_path, monkeypatch):
    """Killed and resumed, it keeps the number of steps that was measured at its start."""
    monkeypatch.setattr(trainer, "seconds_per_step", lambda step, clock: [step() for _ in range(8)] and 0.5)
    monkeypatch.setattr(trainer, "CHECKPOINT_SECONDS", 0.0)

    def stop(state):
        if state.iteration == 25:
            raise KeyboardInterrupt

    supervision, settings = supervise(subject, 0.25), replace(SETTINGS, gtstar_probability=0.5, budget="30s")
    with pytest.raises(KeyboardInterrupt):
        train_surfels(settings, TrainingSubject(subject[1], supervision), Checkpoint(tmp_path / "killed", "key"), stop)
    monkeypatch.setattr(trainer, "seconds_per_step", lambda step, clock: pytest.fail("measured again"))
    surfels, rows = train_surfels(
        settings, TrainingSubject(subject[1], supervision), Checkpoint(tmp_path / "killed", "key")
    )
    steps = with_iterations(settings, 60)  # 30 s of steps that take 0.5 s
    expected, whole = train_surfels(steps, TrainingSubject(subject[1], supervision))
    assert as_bytes(surfels) == as_bytes(expected)
    assert without_clock(rows) == without_clock(whole)
    assert rows[-1][0] == 60


def test_a_checkpoint_of_another_run_is_ignored(subject, tmp_path, monkeypatch):
    surfels, _ = run(subject, tmp_path / "none", iterations=8)
    monkeypatch.setattr(trainer, "progress", _killing_after(5))
    monkeypatch.setattr(trainer, "CHECKPOINT_SECONDS", 0.0)
    with pytest.raises(KeyboardInterrupt):
        run(subject, tmp_path / "state", key="another", iterations=8, seed=1)
    monkeypatch.undo()
    assert (tmp_path / "state").is_file()
    assert as_bytes(run(subject, tmp_path / "state", iterations=8)[0]) == as_bytes(surfels)
    (tmp_path / "state").write_bytes(b"half of a")
    assert as_bytes(run(subject, tmp_path / "state", iterations=8)[0]) == as_bytes(surfels)


def _killing_after(steps):
    from contextlib import contextmanager

    @contextmanager
    def progress(*_):
        def report(done, *_, **__):
            if done > steps:
                raise KeyboardInterrupt

        yield report

    return progress


def test_frozen_surfels_do_not_change_at_all_in_caricature_steps(subject, tmp_path):
    """Neither values nor moments change, although the momentum of earlier real steps would move them."""
    capture = subject[0]
    seen = {"frozen": 0, "free": 0}
    step = Adam.step

    class Watch(Adam):
        def step(self, surfels, rates, frozen=None):
            before = {name: value.detach().clone() for name, value in surfels.attributes()}
            moments = [{k: v.copy() for k, v in m.items()} for m in (self.first, self.second)]
            step(self, surfels, rates, frozen)
            if frozen is None:
                return
            assert (frozen == capture.model.face_region("scalp")[surfels.binding]).all()
            for name, value in surfels.attributes():
                assert torch.equal(value[frozen], before[name][frozen])
                np.testing.assert_array_equal(self.first[name][frozen], moments[0][name][frozen])
                np.testing.assert_array_equal(self.second[name][frozen], moments[1][name][frozen])
                seen["frozen"] += np.count_nonzero(moments[0][name][frozen])  # there was momentum
                seen["free"] += int((value[~frozen] != before[name][~frozen]).sum())

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(trainer, "Adam", Watch)
        run(subject, tmp_path / "c", density=Density(every=0))
    assert seen["frozen"] > 0
    assert seen["free"] > 0


def test_without_masks_nothing_is_frozen(subject):
    example = supervise(subject, 0.25, mask_flags=()).example(True, 0)
    assert example.frozen is None
    assert example.valid is None
    assert not supervise(subject, 0.25).example(True, 0).valid[:12].any()


def test_targets_are_rendered_on_the_caricature_and_frames_on_the_natural_mesh(subject):
    capture = subject[0]
    supervision = supervise(subject, 0.25)
    assert supervision.example(False, 2).level == 0.0
    assert supervision.example(True, 2).level == 0.25
    np.testing.assert_array_equal(supervision.example(False, 2).image, capture.image(capture.split("train")[2]))


def test_every_level_has_its_own_targets_masks_and_frozen_faces(subject, tmp_path):
    capture, _, indices = subject
    content = json.loads(indices[0.1].read_text())
    content["folder"] = str(indices[0.1].parent / content["folder"])
    for entry in content["targets"]:
        entry["weight"] = 0.5
    (tmp_path / "light.json").write_text(json.dumps(content))
    sets = [read_targets(tmp_path / "light.json", capture), read_targets(indices[0.25], capture)]
    sets[0] = replace(sets[0], face_flags=np.zeros_like(sets[0].face_flags))
    supervision = Supervision(capture, sets)
    count = len(capture.split("train"))
    assert len(supervision.targets) == 2 * count
    for i, level, weight in ((1, 0.1, 0.5), (count + 1, 0.25, 1.0)):
        example = supervision.example(True, i)
        frame = capture.split("train")[1]
        assert (example.level, example.weight, example.timestep) == (level, weight, frame.timestep)
        np.testing.assert_allclose(example.image, (1 - level) * capture.image(frame)[:, ::-1], atol=0.5 / 255 + 1e-6)
    assert supervision.example(True, 1).frozen is None
    assert (supervision.example(True, count + 1).frozen == capture.model.face_region("scalp")).all()


def test_each_step_renders_the_level_of_its_target(subject, tmp_path, monkeypatch):
    """All levels come equally often; real frames stay at level 0."""
    capture, sequence, _ = subject
    levels = []
    motion = sequence.motion
    monkeypatch.setattr(initialization, "COLOUR_FRAMES", 1)
    monkeypatch.setattr(sequence, "motion", lambda timestep, level: levels.append(level) or motion(timestep, level))
    targets = 2 * len(capture.split("train"))
    run(
        subject, tmp_path / "c", at=(0.1, 0.25), iterations=2 * targets, gtstar_probability=1.0,
        density=Density(every=0),
    )  # fmt: skip
    levels = levels[1:]  # the first colours
    assert {level: levels.count(level) for level in (0.1, 0.25)} == {0.1: targets, 0.25: targets}


@pytest.mark.usefixtures("images_alone")
def test_the_weight_of_a_target_scales_its_loss(subject, tmp_path):
    """Targets of weight zero do not change anything."""
    capture, sequence, indices = subject
    given = read_targets(indices[0.25], capture)
    settings = replace(SETTINGS, gtstar_probability=1.0, density=Density(every=0))

    def trained(weight, iterations):
        targets = replace(given, targets=tuple(target._replace(weight=weight) for target in given.targets))
        shorter, supervision = replace(settings, iterations=iterations), Supervision(capture, [targets])
        return as_bytes(train_surfels(shorter, TrainingSubject(sequence, supervision))[0])

    assert trained(0.0, 1) == trained(0.0, 4)
    assert trained(1.0, 1) != trained(1.0, 4)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"level": None}, "level"),
        ({"targets": []}, "targets: no frame has a target"),
        ({"targets": [{"timestep": 0, "camera": 0, "image": "a.png"}]}, r"targets\[0\].mask_flags"),
        ({"targets": [{"timestep": 9, "camera": 0, "image": "a", "mask_flags": "b"}]}, "no such training frame"),
        ({"targets": [{"timestep": 0, "camera": 0, "image": "a", "mask_flags": "b", "weight": -1}]}, "weight"),
        ({"folder": "nowhere"}, "faces.npy: no such file"),
    ],
)
def test_an_index_that_is_broken_or_of_another_capture_is_named(subject, tmp_path, change, named):
    content = json.loads(subject[2][0.25].read_text())
    content["folder"] = str(subject[2][0.25].parent / content["folder"])
    (tmp_path / "targets.json").write_text(json.dumps({**content, **change}))
    with pytest.raises(InputError, match=named):
        read_targets(tmp_path / "targets.json", subject[0])


@pytest.mark.parametrize("shape", ["exponential", "cosine"])
def test_learning_rates_decay_to_the_final_factor(shape):
    settings = Train(iterations=100, lr_decay=shape)
    first, last = learning_rates(settings, 0.0), learning_rates(settings, 1.0)
    assert first["position"] == settings.position_lr
    assert last["position"] == pytest.approx(settings.position_lr * settings.position_final_lr_factor)
    assert last["colour"] == pytest.approx(settings.colour_lr * settings.final_lr_factor)
    rates = np.array([learning_rates(settings, p)["opacity"] for p in np.linspace(0, 1, 101)])
    assert (np.diff(rates) < 0).all()
    if shape == "exponential":
        np.testing.assert_allclose(rates[1:] / rates[:-1], rates[1] / rates[0])
    else:  # point-symmetric about the middle, flat at both ends
        np.testing.assert_allclose(rates + rates[::-1], first["opacity"] + last["opacity"])
        assert rates[0] - rates[1] < 0.05 * (rates[50] - rates[51])
