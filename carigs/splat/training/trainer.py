"""The training loop: real frames and GT* targets in random alternation, one view per step."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from carigs.capture import Frame
from carigs.settings import Train
from carigs.splat.render import RenderedFrame, contribution, render
from carigs.splat.rig.head_sequence import HeadSequence
from carigs.splat.surfels.surfels import Surfels
from carigs.splat.training.adam import Adam
from carigs.splat.training.checkpoint import TrainingState, load_checkpoint, run_digest, save_checkpoint
from carigs.splat.training.density import GradientStatistics, densify_and_prune, reset_opacity, scene_extent
from carigs.splat.training.hair_surfels import FADING_STEPS, HairSurfels
from carigs.splat.training.initialization import initial_surfels
from carigs.splat.training.photometric_loss import photometric_loss
from carigs.splat.training.progress import progress
from carigs.splat.training.regularizers import add_threshold_loss, normal_consistency_loss
from carigs.splat.training.schedule import draw_schedule
from carigs.splat.training.supervision import Example, Supervision
from carigs.splat.training.tracking_refinement import TrackingRefinement

PREFETCHED = 4
"""Steps whose images are decoded ahead."""
COLUMNS = ("iteration", "seconds", "caricature", "loss", "psnr", "surfels")
"""Columns of the log: the mean loss since the row before, and the PSNR (dB, valid pixels) of the row's own step."""


def train_surfels(
    settings: Train,
    sequence: HeadSequence,
    supervision: Supervision,
    checkpoint: Path,
    on_step: Callable[[TrainingState], None] | None = None,
    hair: HairSurfels | None = None,
) -> tuple[Surfels, list[tuple]]:
    """Train the surfels of a subject.

    Every step renders one view and compares it with a real frame on the natural mesh, or with a GT* target on the
    caricature mesh of its level: the random alternation of `draw_schedule`. The loss of a step is

        w ((1 - lambda) L1 + lambda (1 - SSIM) + a distortion + b (normal consistency)) + threshold losses

    with the weight w of the target (1 for real frames), see `photometric_loss`, `normal_consistency_loss` and
    `add_threshold_loss`. Surfels on masked triangles are frozen in GT* steps (freezing: see `Supervision` and
    `Adam.step`). Steps, density control and their random draws depend on the settings and the iteration only: a run
    that was interrupted ends in the same bytes as one that was not.

    Args:
        settings: Settings of the stage.
        sequence: The subject; its parameters change if `settings.refine_tracking` is enabled.
        supervision: Training frames and targets.
        checkpoint: File of the state; the run continues from it if it is of the same inputs.
        on_step: Called with the state after every step.
        hair: Where hair is; None if the head has none.

    Returns:
        The trained surfels, and the rows of the log (`COLUMNS`).
    """
    digest = run_digest(settings, sequence, supervision, hair)
    refinement = None
    if settings.refine_tracking.enabled and settings.gtstar_probability < 1:
        refinement = TrackingRefinement(sequence, sorted({frame.timestep for frame in supervision.frames}))
    state = load_checkpoint(checkpoint, digest, len(sequence.rig.faces), refinement)
    if state is None:
        surfels = initial_surfels(settings, supervision, sequence, hair)
        state = TrainingState(0, surfels, Adam(surfels), GradientStatistics(len(surfels)), refinement=refinement)
    run = _Run(settings, sequence, supervision, hair, state)
    started = saved = time.perf_counter()
    earlier = state.seconds
    with progress("train", settings.iterations, state.iteration) as report:
        while state.iteration < settings.iterations:
            loss = run.step()
            now = time.perf_counter()
            state.seconds = earlier + now - started
            report(state.iteration, loss=loss, surfels=len(state.surfels))
            if on_step is not None:
                on_step(state)
            if now - saved > settings.checkpoint_seconds and state.iteration < settings.iterations:
                save_checkpoint(checkpoint, state, digest)
                saved = time.perf_counter()
    return state.surfels, state.log


class _Run:
    """The steps of a run, on a `TrainingState`."""

    def __init__(self, settings: Train, sequence: HeadSequence, supervision: Supervision, hair, state) -> None:
        self.settings, self.sequence, self.supervision, self.state = settings, sequence, supervision, state
        self.hair = hair
        # Surfels of hair start away from their triangles.
        hair_limits = 0.0 if hair is None else hair.position_limits(sequence.rig)
        self.position_limit = np.zeros(len(sequence.rig.faces)) + settings.position_limit + hair_limits
        self.extent = scene_extent(supervision.capture.cameras)
        probability = settings.gtstar_probability if supervision.targets else 0.0
        frames, targets = supervision.frames, supervision.targets
        self.schedule = draw_schedule(settings.iterations, len(frames), len(targets), probability, settings.seed)
        self.only_targets = bool(self.schedule.gtstar.all())

    def step(self) -> float:
        """Render, compare, update; returns the loss."""
        state, settings = self.state, self.settings
        i = state.iteration
        gtstar = bool(self.schedule.gtstar[i])
        example = self.supervision.example(gtstar, int(self.schedule.index[i]))
        for k in range(i + 1, min(i + 1 + PREFETCHED, settings.iterations)):
            self.supervision.prefetch(bool(self.schedule.gtstar[k]), int(self.schedule.index[k]))
        for _, value in state.surfels.attributes():
            value.grad = None
        rendered, loss = self._loss(example, i)
        loss.backward()
        screen = rendered.rendering.screen
        value = float(loss.detach()) + add_threshold_loss(
            state.surfels, screen.visible.numpy(), self.position_limit[state.surfels.binding],
            settings.position_weight, settings.scale_limit, settings.scale_weight,
        )  # fmt: skip
        frozen = None if example.frozen is None else example.frozen[state.surfels.binding]
        if settings.density.every and (not gtstar or self.only_targets):
            state.statistics.add(screen, example.camera)
        if self.hair is not None:
            self.hair.keep_hidden_skin(state.surfels)
        state.adam.step(state.surfels, learning_rates(settings, i), frozen)
        if self.hair is not None:
            self.hair.keep_on_covered_skin(state.surfels)
            if i % FADING_STEPS == 0:
                self.hair.fade_over_bare_skin(state.surfels, self.sequence.rig)
        if state.refinement is not None and not gtstar:
            state.refinement.step(example.timestep, settings.refine_tracking)
        self._control_density(i + 1)
        state.iteration = i + 1
        self._log(value, rendered, example, gtstar)
        return value

    def _loss(self, example: Example, i: int) -> tuple[RenderedFrame, Float[Tensor, ""]]:
        settings = self.settings
        regularized = i >= settings.regularize_from
        distortion, normals = regularized and settings.distortion_weight > 0, regularized and settings.normal_weight > 0
        if self.state.refinement is not None and example.level == 0:
            motion = self.state.refinement.motion(example.timestep)
        else:
            motion = self.sequence.motion(example.timestep, example.level)
        rendered = render(
            self.state.surfels, self.sequence.rig, motion, example.camera, skinning=settings.rig,
            rotate_harmonics=settings.rotate_harmonics, background=self.supervision.capture.background,
            shade=self.sequence.shade(example.timestep, example.level), backend=settings.backend,
            outputs=("distortion",) * distortion + ("alpha", "depth", "normal") * normals,
        )  # fmt: skip
        valid = None if example.valid is None else torch.from_numpy(example.valid)
        loss = photometric_loss(rendered.image, torch.from_numpy(example.image), settings.ssim_weight, valid)
        rendering = rendered.rendering
        if distortion:
            loss = loss + settings.distortion_weight * rendering.distortion.mean()
        if normals:
            consistency = normal_consistency_loss(rendering.normal, rendering.depth, rendering.alpha, example.camera)
            loss = loss + settings.normal_weight * consistency
        return rendered, example.weight * loss

    def _control_density(self, done: int) -> None:
        state, density = self.state, self.settings.density
        if density.every and density.start <= done < density.stop and done % density.every == 0:
            rng = np.random.default_rng([self.settings.seed, 2, done])
            views = [(frame, 0.0) for frame in self.supervision.frames]
            if self.only_targets:
                views = [(target.frame, target.level) for target in self.supervision.targets]
            views = [views[i] for i in rng.choice(len(views), min(density.importance_views, len(views)), replace=False)]
            state.surfels = densify_and_prune(
                state.surfels, state.adam, state.statistics.mean(), self.sequence.rig, self.extent, density, rng,
                lambda: self._importance(views),
            )  # fmt: skip
            state.statistics = GradientStatistics(len(state.surfels))
        if density.reset_every and done % density.reset_every == 0 and done < density.stop:
            reset_opacity(state.surfels, state.adam)

    def _importance(self, views: Sequence[tuple[Frame, float]]) -> Float[np.ndarray, " n"]:
        """Contribution of every surfel to some frames, each at its level."""
        settings, surfels, total = self.settings, self.state.surfels, np.zeros(len(self.state.surfels))
        for frame, level in views:
            camera, motion = self.supervision.capture.camera(frame), self.sequence.motion(frame.timestep, level)
            total += contribution(
                surfels, self.sequence.rig, motion, camera, skinning=settings.rig, backend=settings.backend
            )
        return total

    def _log(self, loss: float, rendered: RenderedFrame, example: Example, gtstar: bool) -> None:
        state = self.state
        state.losses.append(loss)
        if state.iteration % self.settings.log_every and state.iteration < self.settings.iterations:
            return
        error = (rendered.image.detach().numpy().clip(0, 1) - example.image) ** 2
        mean = float((error if example.valid is None else error[example.valid]).mean(dtype=np.float64))
        psnr = -10 * np.log10(max(mean, 1e-12))
        row = (state.iteration, round(state.seconds, 2), int(gtstar), float(np.mean(state.losses)), float(psnr))
        state.log.append((*row, len(state.surfels)))
        state.losses.clear()


def learning_rates(settings: Train, iteration: int) -> dict[str, float]:
    """Learning rate of every attribute at an iteration, decayed log-linearly.

    Args:
        settings: `*_lr` are the rates at the first iteration; `final_lr_factor` (of positions:
            `position_final_lr_factor`) is the factor reached at the last one.
        iteration: Index from 0.

    Returns:
        Learning rate by the name of the attribute.
    """
    progress = iteration / max(settings.iterations - 1, 1)
    decay = settings.final_lr_factor**progress
    return {
        "position": settings.position_lr * settings.position_final_lr_factor**progress,
        "rotation": settings.rotation_lr * decay,
        "log_scale": settings.scale_lr * decay,
        "opacity": settings.opacity_lr * decay,
        "colour": settings.colour_lr * decay,
        "harmonics": settings.colour_lr / 20 * decay,
        "blend": settings.blend_lr * decay,
    }
