"""The training loop: real frames and GT* targets in turn, one view per step."""

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
from carigs.splat.surfels.initialization import initial_surfels
from carigs.splat.surfels.surfels import Surfels
from carigs.splat.training.adam import Adam
from carigs.splat.training.checkpoint import State, fingerprint, load_state, save_state
from carigs.splat.training.density import GradientStatistics, refine, reset_opacity, scene_extent
from carigs.splat.training.photometric_loss import photometric
from carigs.splat.training.progress import progress
from carigs.splat.training.regularizers import normal_mismatch, pull_to_triangles
from carigs.splat.training.supervision import Example, Supervision, draw_schedule
from carigs.splat.training.tracking_refinement import TrackingRefinement

AHEAD = 4
"""Steps whose images are decoded while others are computed."""
COLUMNS = ("iteration", "seconds", "caricature", "loss", "psnr", "surfels")
"""Of the log: the mean loss since the row before, and the PSNR (dB, valid pixels) of the row's own step."""


def train_surfels(
    settings: Train,
    performance: HeadSequence,
    supervision: Supervision,
    checkpoint: Path,
    watch: Callable[[State], None] | None = None,
) -> tuple[Surfels, list[tuple]]:
    """Train from the first surfels, or go on from `checkpoint` if that is of the same run; also returns the log's rows.

    `watch` is shown the state after every step.  With `refine_tracking.enabled` the parameters of `performance` move.
    Steps, density control and their random draws depend on the settings and the iteration alone, so an interrupted run
    ends in the same bytes as one in a single sitting.
    """
    hair = performance.head.face_region(*settings.hair_regions)
    key = fingerprint(settings, performance, supervision)
    tuning = None
    if settings.refine_tracking.enabled and settings.gtstar_probability < 1:
        tuning = TrackingRefinement(performance, sorted({frame.timestep for frame in supervision.frames}))
    state = load_state(checkpoint, key, tuning) if checkpoint.is_file() else None
    if state is None:
        surfels = initial_surfels(settings, supervision, performance, hair)
        state = State(0, surfels, Adam(surfels), GradientStatistics(len(surfels)), tuning=tuning)
    run = _Run(settings, performance, supervision, hair, state)
    started = saved = time.perf_counter()
    earlier = state.seconds
    with progress("train", settings.iterations, state.iteration) as report:
        while state.iteration < settings.iterations:
            loss = run.step()
            now = time.perf_counter()
            state.seconds = earlier + now - started
            report(state.iteration, loss=loss, surfels=len(state.surfels))
            if watch is not None:
                watch(state)
            if now - saved > settings.checkpoint_seconds and state.iteration < settings.iterations:
                save_state(checkpoint, state, key)
                saved = time.perf_counter()
    return state.surfels, state.rows


class _Run:
    """One step after the other on a `State`."""

    def __init__(self, settings, performance, supervision, hair, state: State) -> None:
        self.settings, self.performance, self.supervision, self.state = settings, performance, supervision, state
        rig = performance.rig
        # Hair stands off its triangles by construction.
        reach = np.where(hair, settings.hair_length / np.maximum(rig.scale, 1e-9), 0)
        self.face_limit = settings.position_limit + reach
        self.extent = scene_extent(supervision.capture.cameras)
        share = settings.gtstar_probability if supervision.targets else 0.0
        self.schedule = draw_schedule(
            settings.iterations, len(supervision.frames), len(supervision.targets), share, settings.seed
        )
        self.only_targets = bool(self.schedule.caricature.all())

    def step(self) -> float:
        """Render, compare, move; returns the loss."""
        state, settings = self.state, self.settings
        i = state.iteration
        caricature = bool(self.schedule.caricature[i])
        example = self.supervision.example(caricature, int(self.schedule.index[i]))
        for k in range(i + 1, min(i + 1 + AHEAD, settings.iterations)):
            self.supervision.decode_ahead(bool(self.schedule.caricature[k]), int(self.schedule.index[k]))
        for _, value in state.surfels.attributes():
            value.grad = None
        drawing, loss = self._compare(example, i)
        loss.backward()
        value = float(loss.detach()) + self._pull(drawing)
        frozen = None if example.frozen is None else example.frozen[state.surfels.binding]
        if settings.density.every and (not caricature or self.only_targets):
            state.statistics.add(drawing.rendering.screen, example.camera)
        state.adam.step(state.surfels, learning_rates(settings, i), frozen)
        if state.tuning is not None and not caricature:
            state.tuning.step(example.timestep, settings.refine_tracking)
        self._control_density(i + 1)
        state.iteration = i + 1
        self._record(value, drawing, example, caricature)
        return value

    def _compare(self, example: Example, i: int) -> tuple[RenderedFrame, Float[Tensor, ""]]:
        settings = self.settings
        late = i >= settings.regularize_from
        distortion, normals = late and settings.distortion_weight > 0, late and settings.normal_weight > 0
        outputs = ("distortion",) * distortion + ("alpha", "depth", "normal") * normals
        if self.state.tuning is not None and example.level == 0:
            motion = self.state.tuning.motion(example.timestep)
        else:
            motion = self.performance.motion(example.timestep, example.level)
        drawing = render(
            self.state.surfels,
            self.performance.rig,
            motion,
            example.camera,
            kind=settings.rig,
            rotate_harmonics=settings.rotate_harmonics,
            background=self.supervision.capture.background,
            shade=self.performance.shade(example.timestep, example.level),
            outputs=outputs,
            backend=settings.backend,
        )
        valid = None if example.valid is None else torch.from_numpy(example.valid)
        loss = photometric(drawing.image, torch.from_numpy(example.image), settings.ssim_weight, valid)
        rendering = drawing.rendering
        if distortion:
            loss = loss + settings.distortion_weight * rendering.distortion.mean()
        if normals:
            mismatch = normal_mismatch(rendering.normal, rendering.depth, rendering.alpha, example.camera)
            loss = loss + settings.normal_weight * mismatch
        return drawing, example.weight * loss

    def _pull(self, drawing: RenderedFrame) -> float:
        settings, surfels = self.settings, self.state.surfels
        return pull_to_triangles(
            surfels,
            drawing.rendering.screen.visible.numpy(),
            self.face_limit[surfels.binding],
            settings.position_weight,
            settings.scale_limit,
            settings.scale_weight,
        )

    def _importance(self, chosen: Sequence[tuple[Frame, float]]) -> Float[np.ndarray, "n"]:
        """What the surfels add to views of frames, each at its level."""
        settings, surfels, total = self.settings, self.state.surfels, np.zeros(len(self.state.surfels))
        for frame, level in chosen:
            camera = self.supervision.capture.cameras[frame.camera]
            motion = self.performance.motion(frame.timestep, level)
            total += contribution(
                surfels, self.performance.rig, motion, camera, kind=settings.rig, backend=settings.backend
            )
        return total

    def _control_density(self, done: int) -> None:
        state, density = self.state, self.settings.density
        if density.every and density.start <= done < density.stop and done % density.every == 0:
            rng = np.random.default_rng([self.settings.seed, 2, done])
            gradient = state.statistics.mean()
            views = [(frame, 0.0) for frame in self.supervision.frames]
            if self.only_targets:
                views = [(target.frame, target.level) for target in self.supervision.targets]
            chosen = [
                views[i] for i in rng.choice(len(views), min(density.importance_views, len(views)), replace=False)
            ]
            state.surfels = refine(
                state.surfels, state.adam, gradient, self.performance.rig, self.extent, density, rng,
                lambda: self._importance(chosen),
            )  # fmt: skip
            state.statistics = GradientStatistics(len(state.surfels))
        if density.reset_every and done % density.reset_every == 0 and done < density.stop:
            reset_opacity(state.surfels, state.adam)

    def _record(self, loss: float, drawing: RenderedFrame, example: Example, caricature: bool) -> None:
        state = self.state
        state.losses.append(loss)
        if state.iteration % self.settings.log_every and state.iteration < self.settings.iterations:
            return
        error = (drawing.image.detach().numpy().clip(0, 1) - example.image) ** 2
        mean = float((error if example.valid is None else error[example.valid]).mean(dtype=np.float64))
        psnr = -10 * np.log10(max(mean, 1e-12))
        row = (state.iteration, round(state.seconds, 2), int(caricature), float(np.mean(state.losses)), float(psnr))
        state.rows.append((*row, len(state.surfels)))
        state.losses.clear()


def learning_rates(settings: Train, iteration: int) -> dict[str, float]:
    """Learning rate of every attribute at an iteration, decayed log-linearly.

    Args:
        settings: `*_lr` are the rates at the first iteration; `final_lr_factor` (of positions:
            `position_final_lr_factor`) is the factor reached at the last one.
        iteration: Index from 0.

    Returns:
        The rate of Adam by the name of the attribute.
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
