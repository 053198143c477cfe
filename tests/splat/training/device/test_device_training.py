"""Training with the step in PyTorch on the miniature subject: as the Numba step, to rounding."""

from dataclasses import replace
from functools import partial
from itertools import pairwise
from types import SimpleNamespace

import gsplat_on_cpu
import numpy as np
import pytest
import torch
from miniature import write_ball
from torch.utils._python_dispatch import TorchDispatchMode

from carigs.capture import read_dataset
from carigs.capture.images import write_bits
from carigs.capture.target_index import TargetFrame, TargetSet
from carigs.errors import SettingsError
from carigs.exaggeration.gamma_path import straight_path
from carigs.gtstar import MaskFlag
from carigs.head import neutral
from carigs.settings import Density, RefineTracking, Train
from carigs.splat.avatar import Avatar
from carigs.splat.rasterizer.cuda import rasterize_gsplat
from carigs.splat.rig.head_sequence import head_sequence
from carigs.splat.surfels.surfels import to_arrays
from carigs.splat.training import numba_step, trainer
from carigs.splat.training.checkpoint import Checkpoint
from carigs.splat.training.device import step as device_step
from carigs.splat.training.schedule import draw_schedule
from carigs.splat.training.subject import TrainingSubject, prepare_subject
from carigs.splat.training.supervision import Supervision
from carigs.splat.training.trainer import train_surfels
from carigs.splat.training.training_step import StepInputs

SETTINGS = Train(
    iterations=20, gtstar_probability=0.0, hair_layers=0, sh_degree=1, backend="torch",
    distortion_weight=0.1, normal_weight=0.01,
    density=Density(start=10, stop=19, every=8, gradient_threshold=1e-4, max_surfels=1400),
    # Soft, overlapping discs: small opaque ones, seen edge-on, make images of rounding errors.
    initial_opacity=0.1, initial_scale=0.6,
)  # fmt: skip


@pytest.fixture(autouse=True)
def on_the_host(request, monkeypatch):
    """PyTorch computes on the CPU; density control sees two frames, surfels are small, and the log has more rows."""
    if request.node.get_closest_marker("gpu") is None:
        monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
        monkeypatch.setattr(torch.backends.mps, "is_available", lambda: False)
    monkeypatch.setattr(trainer, "LOG_EVERY", 5)
    monkeypatch.setattr(trainer, "IMPORTANCE_VIEWS", 2)
    for module in (numba_step, device_step):
        monkeypatch.setattr(module, "SCALE_LIMIT", 0.4)


@pytest.fixture(scope="module")
def subject(tmp_path_factory):
    folder = write_ball(tmp_path_factory.mktemp("ball"))
    capture = read_dataset(folder, folder / "head_model.npz")
    rest = neutral(capture.model, capture.parameters(0))
    return capture, straight_path(rest, capture.model.faces, rest * [0.3, 0, 0], 0.25)


def run(subject, checkpoint, on_step=None, **changes):
    capture, path = subject
    settings = replace(SETTINGS, **changes)
    return train_surfels(
        settings,
        TrainingSubject(head_sequence(capture, path), Supervision(capture)),
        Checkpoint(checkpoint, "key"),
        on_step,
    )


def as_bytes(surfels):
    return b"".join(value.tobytes() for value in to_arrays(surfels).values())


def without_clock(rows):
    return [(row[0], *row[2:]) for row in rows]


@pytest.fixture(scope="module")
def kept():
    return []


@pytest.fixture
def whole(kept, subject, tmp_path, on_the_host):
    """A run by `SETTINGS`, the same for all tests."""
    if not kept:
        kept.append(run(subject, tmp_path / "whole"))
    return kept[0]


def test_one_step_is_that_of_the_numba_kernels(subject, tmp_path):
    """Attributes whose gradient is not 0: Adam makes whole steps of a gradient that is rounding alone."""
    expected, found = (to_arrays(run(subject, tmp_path / "c", backend=b, iterations=1)[0]) for b in ("cpu", "torch"))
    for name in ("position", "log_scale", "opacity", "colour", "harmonics"):
        np.testing.assert_allclose(found[name], expected[name], atol=1e-6, err_msg=name)


@pytest.mark.parametrize("dense", [False, True], ids=["fixed", "density control"])
def test_ends_as_the_numba_step(request, subject, tmp_path, dense):
    """Twenty steps with all regularizers: the same losses, PSNR and number of surfels, and the same image."""
    changes = {} if dense else {"density": Density(every=0)}
    expected, expected_rows = run(subject, tmp_path / "c", backend="cpu", **changes)
    found, rows = request.getfixturevalue("whole") if dense else run(subject, tmp_path / "c", **changes)
    assert [row[5] for row in rows] == [row[5] for row in expected_rows]
    assert len({row[5] for row in rows}) == 1 + dense
    for row, other in zip(rows, expected_rows, strict=True):
        assert row[3] == pytest.approx(other[3], rel=5e-3 if dense else 1e-3)
        assert row[4] == pytest.approx(other[4], abs=0.1 if dense else 0.02)
    capture, path = subject
    frame, sequence = capture.split("val")[0], head_sequence(capture, path)
    images = [Avatar(s, sequence).render(frame.timestep, 0.0, capture.camera(frame)) for s in (expected, found)]
    assert np.abs(images[0] - images[1]).mean() < (5e-3 if dense else 1e-3)


def test_images_of_frames_are_those_of_the_numba_step(subject):
    capture, path = subject
    training = prepare_subject(capture, path, SETTINGS)
    schedule = draw_schedule(SETTINGS.iterations, len(training.supervision.frames), 0, 0.0, SETTINGS.seed)
    images = []
    for step in (numba_step.NumbaStep, device_step.DeviceStep):
        settings = replace(SETTINGS, backend="cpu" if step is numba_step.NumbaStep else "torch")
        surfels = trainer.initial_surfels(settings, training.supervision, training.sequence, training.hair)
        work = step(StepInputs(settings, training, schedule))
        state = trainer._first_state(settings.iterations, surfels)
        work.place(state)
        images.append(work.image(state.surfels, training.supervision.frames[0]))
    assert np.abs(images[0] - images[1]).mean() < 1e-3
    assert images[0].std() > 0.1


def test_targets_are_trained_as_by_the_numba_step(subject, tmp_path, monkeypatch):
    """Masked and weighted targets on the caricature, in another light, by turns with real frames."""
    capture, path = subject
    supervision = Supervision(capture, [frames_as_targets(capture, tmp_path)])
    monkeypatch.setattr(trainer, "LOG_EVERY", 1)
    rows = []
    for backend in ("cpu", "torch"):
        settings = replace(SETTINGS, backend=backend, iterations=12, gtstar_probability=0.5, density=Density(every=0))
        sequence = head_sequence(capture, path)
        shade = np.random.default_rng(0).uniform(0.7, 1.3, (len(sequence.rig.faces), 3)).astype(np.float32)
        sequence.shade = lambda timestep, level, shade=shade: shade if level else None
        states = []

        def keep(state, states=states):
            states.append(to_arrays(state.surfels)["colour"][state.surfels.binding < 30].copy())

        rows.append(train_surfels(settings, TrainingSubject(sequence, supervision), on_step=keep)[1])
        # Surfels of masked triangles change in steps with real frames alone.
        changed = [not np.array_equal(a, b) for a, b in pairwise(states)]
        assert changed == [row[2] == 0 for row in rows[-1][1:]]
    assert {row[2] for row in rows[0]} == {0, 1}
    for row, other in zip(*rows, strict=True):
        assert row[3] == pytest.approx(other[3], rel=1e-3)


def test_equal_settings_give_equal_bytes(subject, whole, tmp_path):
    again = run(subject, tmp_path / "c")
    assert as_bytes(again[0]) == as_bytes(whole[0])
    assert without_clock(again[1]) == without_clock(whole[1])


@pytest.mark.sample(1)
@pytest.mark.parametrize("refined", [False, True])
def test_a_killed_run_resumes_to_the_same_bytes(request, subject, tmp_path, monkeypatch, refined):
    """With the tracking refined, too: its gradients leave the device."""
    changes = {"refine_tracking": RefineTracking(until=0.5)} if refined else {}
    surfels, rows = run(subject, tmp_path / "none", **changes) if refined else request.getfixturevalue("whole")

    def kill(state):
        if state.iteration == 12:
            raise KeyboardInterrupt

    monkeypatch.setattr(trainer, "CHECKPOINT_SECONDS", 0.0)
    with pytest.raises(KeyboardInterrupt):
        run(subject, tmp_path / "state", kill, **changes)
    steps = []
    resumed, resumed_rows = run(subject, tmp_path / "state", lambda state: steps.append(state.iteration), **changes)
    assert steps[0] == 12
    assert as_bytes(resumed) == as_bytes(surfels)
    assert without_clock(resumed_rows) == without_clock(rows)


def test_surfels_that_are_not_finite_do_not_spread(subject, tmp_path, monkeypatch):
    """One broken attribute each: the others train on, and nothing else is NaN."""
    names, first = (
        ("position", "rotation", "log_scale", "opacity", "colour", "harmonics", "blend"),
        trainer.initial_surfels,
    )

    def broken(*arguments):
        surfels = first(*arguments)
        with torch.no_grad():
            for k, name in enumerate(names):
                getattr(surfels, name)[40 * k + 3] = torch.nan
        return surfels

    monkeypatch.setattr(trainer, "initial_surfels", broken)
    surfels, rows = run(subject, tmp_path / "c", iterations=6, density=Density(every=0))
    assert np.isfinite([row[3] for row in rows]).all()
    bad = np.zeros(len(surfels), bool)
    bad[[40 * k + 3 for k in range(len(names))]] = True
    for _, value in surfels.attributes():
        assert value[torch.from_numpy(~bad)].isfinite().all()


def test_no_such_device_is_a_readable_error(subject, tmp_path):
    with pytest.raises(SettingsError, match="backend cuda"):
        run(subject, tmp_path / "c", backend="cuda")


def test_the_step_of_backend_cuda_with_the_reference_of_gsplat(subject, tmp_path, monkeypatch):
    """The calls of a whole step, on the CPU: a few steps end where those of the plain rasterizer do."""
    pytest.importorskip("gsplat", reason="gsplat is not installed: pip install --no-deps gsplat==1.5.3")
    # Both without distortion, which gsplat's reference lacks; opacities stay below both caps.
    changes = {"iterations": 3, "distortion_weight": 0.0, "density": Density(every=0)}
    expected, expected_rows = run(subject, tmp_path / "c", **changes)
    with gsplat_on_cpu.functions() as functions:
        device = torch.device("cpu")
        rasterizer = partial(rasterize_gsplat, functions, device=device)
        monkeypatch.setattr(device_step, "open_device", lambda settings: (device, rasterizer))
        found, rows = run(subject, tmp_path / "c", backend="cuda", **changes)
    assert rows[-1][3] == pytest.approx(expected_rows[-1][3], rel=1e-3)
    assert rows[-1][4] == pytest.approx(expected_rows[-1][4], abs=0.02)
    assert len(found) == len(expected)


READS = {"aten::_local_scalar_dense", "aten::nonzero", "aten::masked_select", "aten::is_nonzero", "aten::equal"}
"""Operations after which the host waits for the device."""


class NoReads(TorchDispatchMode):
    """Refuses operations that read from the device; a mask as an index is one, too."""

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        name = func.name().partition(".")[0]
        masks = args[1] if name in ("aten::index", "aten::index_put", "aten::index_put_") else ()
        assert name not in READS and not any(m is not None and m.dtype == torch.bool for m in masks), func
        return func(*args, **(kwargs or {}))


def blurred(means2d, ray_transforms, colors, opacities, normals, densify, width, height, *lists, distloss):
    """Images that depend on everything, instead of gsplat's: a mean over all surfels in every pixel."""
    mean = (means2d.mean(), ray_transforms.mean(), opacities.mean(), normals[..., 2].mean())
    ones = torch.ones(1, height, width, 1, device=means2d.device) * (1 + 1e-3 * sum(mean))
    return colors.mean(dim=1) * ones, ones, normals.mean(dim=1) * ones, ones, ones


def frames_as_targets(capture, folder):
    """The frames as targets of level 0.25, half masked; the first thirty triangles are masked in all of them."""
    frames, masks = capture.split("train"), np.zeros((48, 40), np.uint16)
    masks[:24] = MaskFlag.HAIR.value
    write_bits(folder / "masks.png", masks)
    targets = [TargetFrame(frame, 0.25, capture.root / frame.image, folder / "masks.png", 0.5) for frame in frames]
    flags = np.where(np.arange(len(capture.model.faces)) < 30, MaskFlag.HAIR.value, 0).astype(np.uint16)
    return TargetSet(0.25, folder, tuple(targets), flags)


@pytest.mark.parametrize("gtstar", [0.0, 1.0])
def test_a_step_with_gsplat_reads_nothing_back(subject, tmp_path, monkeypatch, gtstar):
    """No `.item()`, no `.numpy()`, no `.cpu()`, no boolean index in all that a step does around gsplat's kernels."""
    with NoReads(), pytest.raises(AssertionError):
        torch.ones(3)[torch.tensor([True, False, True])]
    functions = SimpleNamespace(
        isect_tiles=lambda *_: (None, None, None),
        isect_offset_encode=lambda pairs, images, across, down: torch.zeros(images, down, across),
        rasterize_to_pixels_2dgs=blurred,
    )
    device = torch.device("cpu")
    monkeypatch.setattr(
        device_step, "open_device", lambda settings: (device, partial(rasterize_gsplat, functions, device=device))
    )
    update, steps = device_step.DeviceStep.update, []

    def watched(self, *arguments):
        def refuse(*_):
            raise AssertionError("read from the device")

        with NoReads(), pytest.MonkeyPatch.context() as patch:
            for name in ("numpy", "cpu", "tolist", "item", "__float__", "__bool__"):
                patch.setattr(torch.Tensor, name, refuse)
            steps.append(update(self, *arguments))
        return steps[-1]

    monkeypatch.setattr(device_step.DeviceStep, "update", watched)
    capture, path = subject
    supervision = Supervision(capture)
    if gtstar:
        supervision = Supervision(capture, [frames_as_targets(capture, tmp_path)])
    settings = replace(SETTINGS, backend="cuda", iterations=4, gtstar_probability=gtstar,
                       density=Density(start=3, stop=4, every=3, gradient_threshold=1e9))  # fmt: skip
    before = to_arrays(trainer.initial_surfels(settings, supervision, head_sequence(capture, path), None))
    surfels, _ = train_surfels(settings, TrainingSubject(head_sequence(capture, path), supervision))
    assert len(steps) == 4
    frozen = before["binding"] < 30 if gtstar else np.zeros(len(before["binding"]), bool)
    after = to_arrays(surfels)
    assert (after["colour"][frozen] == before["colour"][frozen]).all()
    assert (after["colour"][~frozen] != before["colour"][~frozen]).any()


gpu = [pytest.mark.gpu, pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")]


@pytest.mark.parametrize("backend", [pytest.param(name, marks=gpu) for name in ("torch", "cuda")])
def test_a_gpu_ends_as_the_numba_step(subject, tmp_path, backend):
    """Opacities stay below the caps on alpha of both rasterizers."""
    if backend == "cuda":
        pytest.importorskip("gsplat")
    changes = {"density": Density(every=0)}
    (_, expected), (_, rows) = (run(subject, tmp_path / "c", backend=name, **changes) for name in ("cpu", backend))
    for row, other in zip(rows, expected, strict=True):
        assert row[3] == pytest.approx(other[3], rel=1e-2)
        assert row[4] == pytest.approx(other[4], abs=0.1)


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_a_step_on_a_gpu_never_waits(subject, tmp_path, monkeypatch):
    """Around gsplat's kernels, which wait themselves: CUDA says so."""
    device = torch.device("cuda")
    functions = SimpleNamespace(
        isect_tiles=lambda *_: (None, None, None),
        isect_offset_encode=lambda pairs, images, across, down: torch.zeros(images, down, across, device=device),
        rasterize_to_pixels_2dgs=blurred,
    )
    opened = device, partial(rasterize_gsplat, functions, device=device)
    monkeypatch.setattr(device_step, "open_device", lambda settings: opened)
    update = device_step.DeviceStep.update

    def watched(self, state, i, rates):
        torch.cuda.set_sync_debug_mode("error" if i else "default")  # the first step allocates
        try:
            return update(self, state, i, rates)
        finally:
            torch.cuda.set_sync_debug_mode("default")

    monkeypatch.setattr(device_step.DeviceStep, "update", watched)
    run(subject, tmp_path / "c", backend="cuda", iterations=4, density=Density(every=0))
