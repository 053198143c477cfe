"""The training loop: real frames and GT* targets in random alternation, one view per step."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from carigs.capture import Frame
from carigs.editing.dataset_update import DatasetUpdate
from carigs.settings import Train
from carigs.settings.train import budget_seconds
from carigs.splat.surfels.surfels import Surfels, from_arrays, to_arrays
from carigs.splat.training.adam import Adam
from carigs.splat.training.budget import LEAST_STEPS, TRIAL_STEPS, seconds_per_step, with_iterations
from carigs.splat.training.checkpoint import Checkpoint, TrainingState, load_checkpoint, save_checkpoint
from carigs.splat.training.density import GradientStatistics, densify_and_prune, reset_opacity, scene_extent
from carigs.splat.training.initial_surfels.initialization import initial_surfels
from carigs.splat.training.numba_step import NumbaStep
from carigs.splat.training.progress import progress
from carigs.splat.training.schedule import draw_schedule
from carigs.splat.training.subject import TrainingSubject
from carigs.splat.training.tracking_refinement import TrackingRefinement
from carigs.splat.training.training_step import StepInputs, StepResult, TrainingStep

DEVICE_BACKENDS = ("torch", "cuda")
"""Backends whose whole step is on a device."""
CHECKPOINT_SECONDS = 60.0
"""Time between two checkpoints."""
SCALE_LR, OPACITY_LR, BLEND_LR = 0.017, 0.05, 0.001
"""Learning rates of the first step, those of SurFhead: of log scales, opacity logits, and the skinning weights of
`jbs`."""
LOG_EVERY = 20
"""Steps between two rows of the log."""
IMPORTANCE_VIEWS = 8
"""Training frames over which density control measures the importance of surfels."""
REFINEMENT_FACTOR = 1.4
"""Time of a step that refines the tracking, over one that does not."""
COLUMNS = ("iteration", "seconds", "caricature", "loss", "psnr", "surfels")
"""Columns of the log: the mean loss since the row before, and the PSNR (dB, valid pixels) of the row's own step."""


def train_surfels(
    settings: Train,
    subject: TrainingSubject,
    checkpoint: Checkpoint | None = None,
    on_step: Callable[[TrainingState], None] | None = None,
    edits: DatasetUpdate | None = None,
) -> tuple[Surfels, list[tuple]]:
    """Train the surfels of a subject.

    Every step renders one view and compares it with a real frame on the natural mesh, or with a GT* target on the
    caricature mesh of its level: the random alternation of `draw_schedule`. The loss of a step is

        w ((1 - lambda) L1 + lambda (1 - SSIM) + a distortion + b (normal consistency)) + threshold losses

    with the weight w of the target (1 for real frames), see `photometric_loss`, `normal_consistency_loss` and
    `add_threshold_loss`. Gradients of pixels near the outline of the mesh count for more, see `Outlines`. Surfels on
    masked triangles are frozen in GT* steps (freezing: see `Supervision` and `Adam.step`). Steps, density control and
    their random draws depend on the settings and the iteration only: a run that was interrupted ends in the same bytes
    as one that was not.

    Args:
        settings: Settings of the stage.
        subject: Motion and images of the head, its hair and mouth; the parameters of its head change if
            `settings.refine_tracking` has steps that do.
        checkpoint: Where the state is kept; the run continues from one with the same key. None keeps no state.
        on_step: Called with the state after every step.
        edits: Edits of the frames while the training goes on; None if the frames stay as they are.

    Returns:
        The trained surfels, and the rows of the log (`COLUMNS`).
    """
    refinement = None
    if settings.refine_tracking.until and settings.gtstar_probability < 1:
        timesteps = sorted({frame.timestep for frame in subject.supervision.frames})
        refinement = TrackingRefinement(subject.sequence, timesteps)
    state = None
    if checkpoint is not None:
        state = load_checkpoint(checkpoint, len(subject.sequence.rig.faces), refinement, edits)
    if state is None:
        surfels = initial_surfels(
            settings,
            subject.supervision,
            subject.sequence,
            subject.hair,
            subject.inside,
            subject.unseen,
            subject.body_cover,
        )
        if (budget := budget_seconds(settings.budget)) is not None:
            settings = with_iterations(settings, _steps_within(budget, settings, subject, surfels))
        state = _first_state(settings.iterations, surfels, refinement, edits)
    elif settings.budget is not None:
        settings = with_iterations(settings, state.iterations)
    run = _Run(settings, subject, state)
    started = saved = time.perf_counter()
    earlier = state.seconds
    with progress("train", state.iterations, state.iteration) as report:
        while state.iteration < state.iterations:
            run.step()
            now = time.perf_counter()
            state.seconds = earlier + now - started
            report(state.iteration, state.iterations, **run.shown, surfels=len(state.surfels))
            if on_step is not None:
                on_step(state)
            if checkpoint is None or now - saved <= CHECKPOINT_SECONDS:
                continue
            if state.iteration < state.iterations:
                save_checkpoint(checkpoint, state)
                saved = time.perf_counter()
    return from_arrays(**to_arrays(state.surfels)), state.log


def _first_state(
    iterations: int,
    surfels: Surfels,
    refinement: TrackingRefinement | None = None,
    edits: DatasetUpdate | None = None,
) -> TrainingState:
    statistics = GradientStatistics(len(surfels))
    return TrainingState(0, iterations, surfels, Adam(surfels), statistics, refinement=refinement, edits=edits)


def _steps_within(seconds: float, settings: Train, subject: TrainingSubject, surfels: Surfels) -> int:
    """Number of steps that fit into a time: some are tried on a copy of the surfels."""
    trial = with_iterations(settings, TRIAL_STEPS)
    trial = replace(
        trial, density=replace(trial.density, every=0, reset_every=0),
        refine_tracking=replace(trial.refine_tracking, until=0.0),
    )  # fmt: skip
    run = _Run(trial, subject, _first_state(TRIAL_STEPS, from_arrays(**to_arrays(surfels))))
    clock = time.perf_counter if settings.backend in DEVICE_BACKENDS else time.process_time
    step = seconds_per_step(run.step, clock)
    step *= 1 + (REFINEMENT_FACTOR - 1) * settings.refine_tracking.until
    return max(LEAST_STEPS, int(seconds / step))


class _Run:
    """The steps of a run, on a `TrainingState`."""

    def __init__(self, settings: Train, subject: TrainingSubject, state: TrainingState) -> None:
        self.settings, self.state = settings, state
        self.sequence, self.supervision = subject.sequence, subject.supervision
        self.extent = scene_extent(self.supervision.capture.cameras)
        frames, targets = self.supervision.frames, self.supervision.targets
        probability = settings.gtstar_probability if targets else 0.0
        schedule = draw_schedule(settings.iterations, len(frames), len(targets), probability, settings.seed)
        self.inputs = StepInputs(settings, subject, schedule)
        self.only_targets = self.inputs.only_targets
        self.work = _step_of(self.inputs)
        self.work.place(state)
        self.shown: dict[str, float] = {}
        self.kept = self.supervision.kept
        # The budget is for surfels that learn.
        self._density = replace(settings.density, max_surfels=settings.density.max_surfels + subject.copies)
        if state.edits is not None:
            self.supervision.replaced = state.edits.images
            self.kept_by_edits = state.edits.frozen(self.kept)

    def step(self) -> None:
        """Render, compare, update; then what is done once in a while."""
        state, settings, i = self.state, self.settings, self.state.iteration
        self._edit(i)
        if state.edits is None:
            fallen = i / max(settings.iterations - 1, 1)
        else:
            fallen = state.edits.progress(i, settings.iterations)
        result = self.work.update(state, i, learning_rates(settings, fallen))
        gtstar, index = self.inputs.scheduled(i)
        if self.inputs.refines_tracking(i):
            state.refinement.step(self.supervision.frames[index].timestep, settings.refine_tracking)
        self._control_density(i + 1)
        state.iteration = i + 1
        self._log(result, gtstar)

    def _edit(self, i: int) -> None:
        """Replace a frame by its edit, where that is due, and keep what is outside the edited regions."""
        edits, iterations = self.state.edits, self.settings.iterations
        if edits is None:
            return
        if i >= edits.begin(iterations):
            self.supervision.kept = self.kept_by_edits
        if (index := edits.due(i, iterations)) is not None:
            vertices = self.sequence.posed(self.supervision.frames[index].timestep, 0.0)
            edits.update(i, index, vertices, lambda frame: self.work.image(self.state.surfels, frame))
            self.work.forget_images()

    def _control_density(self, done: int) -> None:
        state, density = self.state, self._density
        edits = state.edits
        # Surfels that are frozen with the first edit need the steps of a refinement to settle.
        first = None if edits is None or edits.faces is None else edits.begin(self.settings.iterations)
        settles = first is not None and first - density.every < done <= first
        if density.every and density.start <= done < density.stop and done % density.every == 0 and not settles:
            rng = np.random.default_rng([self.settings.seed, 2, done])
            views = [(frame, 0.0) for frame in self.supervision.frames]
            if self.only_targets:
                views = [(target.frame, target.level) for target in self.supervision.targets]
            views = [views[i] for i in rng.choice(len(views), min(IMPORTANCE_VIEWS, len(views)), replace=False)]
            state.surfels = densify_and_prune(
                state.surfels, state.adam, state.statistics.mean(), self.sequence.rig, self.extent, density, rng,
                lambda: self._importance(views), self._kept,
            )  # fmt: skip
            self.work.start_statistics(state)
        if density.reset_every and done % density.reset_every == 0 and done < density.stop:
            reset_opacity(state.surfels, state.adam, kept=self._kept)

    @property
    def _kept(self) -> Bool[np.ndarray, " n"] | None:
        """Surfels that stay as they are."""
        kept = self.supervision.kept
        return None if kept is None else kept[self.state.surfels.binding]

    def _importance(self, views: Sequence[tuple[Frame, float]]) -> Float[np.ndarray, " n"]:
        """Contribution of every surfel to some frames, each at its level."""
        return np.sum([self._contribution(*view) for view in views], axis=0)

    def _contribution(self, frame: Frame, level: float) -> Float[np.ndarray, " n"]:
        """Contribution of every surfel to a frame."""
        return self.work.contribution(self.state.surfels, frame, level)

    def _log(self, result: StepResult, gtstar: bool) -> None:
        state = self.state
        state.losses.append(result.loss)
        if isinstance(result.loss, float):
            self.shown["loss"] = result.loss
        if state.iteration % LOG_EVERY and state.iteration < state.iterations:
            return
        image, target = (values.detach().cpu().numpy() for values in (result.image, result.target))
        error = (image.clip(0, 1) - target) ** 2
        mean = float((error if result.valid is None else error[result.valid.cpu().numpy()]).mean(dtype=np.float64))
        psnr = -10 * np.log10(max(mean, 1e-12))
        self.shown["loss"] = loss = float(np.mean([float(loss) for loss in state.losses]))
        row = (state.iteration, round(state.seconds, 2), int(gtstar), loss, float(psnr))
        state.log.append((*row, len(state.surfels)))
        state.losses.clear()


def _step_of(inputs: StepInputs) -> TrainingStep:
    """The step of the backend."""
    if inputs.settings.backend not in DEVICE_BACKENDS:
        return NumbaStep(inputs)
    from carigs.splat.training.device.step import DeviceStep

    return DeviceStep(inputs)


def learning_rates(settings: Train, progress: float) -> dict[str, float]:
    """Learning rate of every attribute, decayed as `settings.lr_decay` says.

    Args:
        settings: `*_lr` are rates of the first step; `final_lr_factor` (of positions:
            `position_final_lr_factor`) is the factor reached at the last one.
        progress: 0 at the first step, 1 at the last one.

    Returns:
        Learning rate by the name of the attribute.
    """
    decay, position_decay = (
        _decay(settings.lr_decay, final, progress)
        for final in (settings.final_lr_factor, settings.position_final_lr_factor)
    )
    return {
        "position": settings.position_lr * position_decay,
        "rotation": settings.rotation_lr * decay,
        "log_scale": SCALE_LR * decay,
        "opacity": OPACITY_LR * decay,
        "colour": settings.colour_lr * decay,
        "harmonics": settings.colour_lr * settings.harmonics_lr_factor * decay,
        "blend": BLEND_LR * decay,
    }


def _decay(shape: str, final: float, progress: float) -> float:
    if shape == "cosine":
        return final + (1 - final) * 0.5 * (1 + float(np.cos(np.pi * progress)))
    return final**progress
