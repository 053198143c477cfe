"""Trainings whose frames are edited: an editor that changes nothing, one that inverts, interruptions, and masks."""

from dataclasses import replace

import numpy as np
import pytest
from miniature import bust_cameras, bust_with_nose, write_ball
from tiny_diffusion import write_diffusion_model

from carigs.capture import read_dataset
from carigs.editing.dataset_update import DatasetUpdate
from carigs.editing.edit_steps import first_edit
from carigs.editing.editor import make_editor
from carigs.exaggeration import straight_path
from carigs.head import neutral
from carigs.settings import Density, Edit, Train
from carigs.splat.avatar import Avatar
from carigs.splat.rig.head_sequence import head_sequence
from carigs.splat.surfels.surfels import to_arrays
from carigs.splat.training import trainer
from carigs.splat.training.checkpoint import Checkpoint
from carigs.splat.training.schedule import draw_schedule
from carigs.splat.training.subject import TrainingSubject
from carigs.splat.training.supervision import Supervision
from carigs.splat.training.trainer import train_surfels

SETTINGS = Train(
    iterations=40,
    gtstar_probability=0,
    relight_surfels=False,
    density=Density(start=10, stop=38, every=6, gradient_threshold=1e-5, max_surfels=2200),
)

EVERY_OTHER = Edit(editor="drawn_nose", every=2)


@pytest.fixture(scope="module")
def bust(tmp_path_factory):
    folder = write_ball(tmp_path_factory.mktemp("bust") / "bust", model=bust_with_nose(), cameras=bust_cameras())
    capture = read_dataset(folder, folder / "head_model.npz")
    rest = neutral(capture.model, capture.parameters(0))
    return capture, head_sequence(capture, straight_path(rest, capture.model.faces, 0 * rest, 0.25))


def unchanged(view):
    return view.captured


def inverted(view):
    return 1 - view.captured


def noisy(view):
    """An edit that depends on its seed and on what is rendered, as that of a diffusion model does."""
    noise = np.random.default_rng(view.seed).random(view.rendered.shape, dtype=np.float32)
    return (0.5 * view.rendered + 0.5 * noise).astype(np.float32)


def run(bust, editor=None, checkpoint=None, on_step=None, *, edit=EVERY_OTHER, from_avatar=False, **changes):
    capture, sequence = bust
    settings = replace(SETTINGS, edit=edit, **changes)
    edits = editor and DatasetUpdate(edit, capture, settings.seed, from_avatar=from_avatar, editor=editor)
    subject = TrainingSubject(sequence, Supervision(capture))
    kept = None if checkpoint is None else Checkpoint(checkpoint, "key")
    return train_surfels(settings, subject, kept, on_step, edits)


def as_bytes(surfels):
    return b"".join(value.tobytes() for value in to_arrays(surfels).values())


def test_an_editor_that_changes_nothing_gives_the_training_without_edits(bust):
    """With edits from the first step on, so that learning rates are the same."""
    plain = as_bytes(run(bust)[0])
    assert as_bytes(run(bust, unchanged, from_avatar=True)[0]) == plain
    assert as_bytes(run(bust, noisy, from_avatar=True)[0]) != plain


@pytest.mark.slow
def test_the_avatar_becomes_what_the_edits_show(bust):
    """Inverted frames: in the end the avatar is nearer to them than to the frames of the capture."""
    capture, sequence = bust
    edit = Edit(editor="drawn_nose", every=1)
    surfels, _ = run(bust, inverted, iterations=160, edit=edit, colour_lr=0.1)
    avatar = Avatar(surfels, sequence)
    for frame in capture.split("train")[:4]:
        image = avatar.render(frame.timestep, 0.0, capture.camera(frame))
        head = capture.mask(frame) > 0.99
        captured, edited = capture.image(frame)[head], 1 - capture.image(frame)[head]
        assert np.abs(image[head] - edited).mean() < 0.5 * np.abs(image[head] - captured).mean()


@pytest.mark.sample(2)
@pytest.mark.parametrize("stop", [22, 7, 33])
@pytest.mark.parametrize("regions", [(), ("nose",)])
def test_an_interrupted_run_ends_in_the_same_bytes(bust, stop, regions, tmp_path, monkeypatch):
    """Among the edits, before the first, and after the last one."""
    monkeypatch.setattr(trainer, "CHECKPOINT_SECONDS", -1)
    edit = Edit(editor="drawn_nose", every=2, regions=regions)

    class Killed(Exception):
        pass

    def kill(state):
        if state.iteration == stop:
            raise Killed

    with pytest.raises(Killed):
        run(bust, noisy, tmp_path / "c", kill, edit=edit)
    steps = []
    surfels, _ = run(bust, noisy, tmp_path / "c", lambda state: steps.append(state.iteration), edit=edit)
    assert steps[0] == stop  # the state before the step that was killed
    assert as_bytes(surfels) == as_bytes(run(bust, noisy, edit=edit)[0])


@pytest.mark.slow
def test_a_device_sees_the_edited_frames_as_the_host_does(bust, monkeypatch):
    """With a seed by which a step takes the frame that has its first edit then: no older image may be copied ahead."""
    monkeypatch.setattr(trainer, "LOG_EVERY", 1)
    edit, steps = Edit(editor="drawn_nose", every=1), 15

    def meets(seed):
        edits = DatasetUpdate(edit, bust[0], seed, from_avatar=True, editor=inverted)
        taken = draw_schedule(steps, len(edits.frames), 0, 0.0, seed).index
        return any(edits.due(i, steps) == taken[i] for i in range(1, steps))

    seed = next(seed for seed in range(100) if meets(seed))
    settings = {"iterations": steps, "density": Density(every=0), "edit": edit, "from_avatar": True, "seed": seed}
    losses = [[row[3] for row in run(bust, inverted, backend=backend, **settings)[1]] for backend in ("cpu", "torch")]
    np.testing.assert_allclose(*losses, rtol=0.02)
    assert max(losses[0]) > 10 * min(losses[0])  # edited frames, and frames that are not edited yet


@pytest.mark.slow
def test_so_does_one_that_a_diffusion_model_edits(bust, tmp_path, monkeypatch):
    monkeypatch.setattr(trainer, "CHECKPOINT_SECONDS", -1)
    monkeypatch.setenv("CARIGS_WEIGHTS", str(tmp_path))
    write_diffusion_model(tmp_path / "instruct-pix2pix", in_channels=8, sample_size=8)
    edit = Edit(editor="instruct_pix2pix", every=3, steps=2, regions=("nose",))
    editor = make_editor(edit, bust[0], 0)

    class Killed(Exception):
        pass

    def kill(state):
        if state.iteration == 27:
            raise Killed

    with pytest.raises(Killed):
        run(bust, editor, tmp_path / "c", kill, edit=edit)
    # The next run loads the networks again.
    resumed = run(bust, make_editor(edit, bust[0], 0), tmp_path / "c", edit=edit)[0]
    whole = as_bytes(run(bust, editor, edit=edit)[0])
    assert as_bytes(resumed) == whole != as_bytes(run(bust, unchanged, edit=edit)[0])


def test_surfels_outside_the_edited_region_stay_as_they_are(bust):
    edit = Edit(editor="drawn_nose", every=2, regions=("nose",))
    nose = bust[0].model.face_region("nose")
    before = {}

    def keep(state):
        if state.iteration == first_edit(SETTINGS.iterations):
            before.update({name: value.copy() for name, value in to_arrays(state.surfels).items()})

    surfels, _ = run(bust, noisy, on_step=keep, edit=edit, density=Density(every=0))
    after = to_arrays(surfels)
    inside = nose[before["binding"]]
    assert 0 < inside.sum() < len(inside)
    np.testing.assert_array_equal(after["binding"], before["binding"])
    for name, value in before.items():
        np.testing.assert_array_equal(after[name][~inside], value[~inside])
    assert (after["colour"][inside] != before["colour"][inside]).any(axis=-1).mean() > 0.5


def test_density_control_leaves_them_alone_too(bust):
    edit = Edit(editor="drawn_nose", every=2, regions=("nose",))
    nose, before = bust[0].model.face_region("nose"), {}

    def keep(state):
        if state.iteration == first_edit(SETTINGS.iterations):
            before.update({name: value.copy() for name, value in to_arrays(state.surfels).items()})

    surfels, _ = run(bust, noisy, on_step=keep, edit=edit)
    rows = [
        {row.tobytes() for row in arrays["position"][~nose[arrays["binding"]]]}
        for arrays in (before, to_arrays(surfels))
    ]
    assert rows[0] == rows[1] and len(rows[0]) > 100
