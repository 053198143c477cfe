"""A subject of a study that has run: what its trainings read, and the held-out frames of its tables."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from carigs.capture import Capture
from carigs.capture.frame_index import read_ground_truth
from carigs.capture.images import read_grey, read_rgb
from carigs.capture.target_index import TargetSet, read_targets, write_targets
from carigs.config import load_settings
from carigs.exaggeration import GammaPath
from carigs.gtstar.target_set import make_target_set
from carigs.hair import FoundHair, load_hair
from carigs.head import neutral, read_subject_path
from carigs.settings import Gtstar, Hair, Train
from evaluation.benchmarks.measurement.toy_training import HeldOutView, held_out_view
from evaluation.metrics.regions import surface_regions


@dataclass(frozen=True)
class StudySubject:
    """A subject of a study at its gamma, and the settings of a variant."""

    folder: Path
    """`results/STUDY/SUBJECT/gamma=GAMMA`."""
    capture: Capture
    path: GammaPath
    hair: FoundHair
    train: Train
    gtstar: Gtstar
    """Settings of the targets of the variant `alternating`."""
    hair_settings: Hair

    @classmethod
    def load(cls, folder: Path, variant: str = "alternating") -> StudySubject:
        """Read what the study has written.

        Args:
            folder: Its results for the subject at a gamma.
            variant: Variant whose settings are read.

        Returns:
            The subject.

        Raises:
            InputError: A file is missing or malformed.
        """
        name, settings = folder.parent.name, folder.parent.parent / "settings"
        capture = Capture.load(folder.parent / "capture.json")
        return cls(
            folder,
            capture,
            read_subject_path(folder / "path.npz", capture.model),
            load_hair(folder.parent / "hair.npz", len(capture.model.faces)),
            load_settings("train", settings / "train" / f"subject={name},variant={variant},seed=0.yaml"),
            load_settings("gtstar", settings / "gtstar" / f"subject={name},variant=alternating.yaml"),
            load_settings("hair", settings / "hair" / f"subject={name}.yaml"),
        )

    def settings_for(self, steps: int) -> Train:
        """Settings of a training with another number of steps.

        Args:
            steps: Number of steps; density control ends after two thirds of them.

        Returns:
            The settings.
        """
        density = replace(self.train.density, stop=2 * steps // 3)
        return replace(self.train, iterations=steps, density=density)

    def targets(self) -> TargetSet:
        """The targets of the variant `alternating`.

        Returns:
            GT* frames at gamma.
        """
        level = f"level={self.path.gamma_f:g}"
        return read_targets(self.folder / "targets/alternating" / level / "targets.json", self.capture)

    def targets_without_shadow(self, folder: Path) -> TargetSet:
        """Make targets in which hair casts no shadow.

        Args:
            folder: Empty folder to write to.

        Returns:
            GT* frames at gamma.
        """
        images, records, index = folder / "images", folder / "records", folder / "targets.json"
        images.mkdir()
        records.mkdir()
        settings = replace(self.gtstar, hair_extinction=0.0)
        caricature = self.path.at(self.path.gamma_f)
        entries = make_target_set(settings, self.capture, caricature, images, records, self.hair)
        write_targets(index, self.path.gamma_f, images, *entries)
        return read_targets(index, self.capture)

    def views(self, level: float) -> list[HeldOutView]:
        """The held-out frames with a true image.

        Args:
            level: Level of exaggeration.

        Returns:
            The frames with their regions.
        """
        capture, model, caricature, views = self.capture, self.capture.model, self.path.at(level), []
        surface = surface_regions(model, neutral(model, capture.parameters(capture.frames[0].timestep)))
        truth = read_ground_truth(self.folder / f"truth/level={level:g}/truth.json")
        for frame in capture.split("test"):
            key = frame.timestep, frame.camera
            if key in truth.images:
                images = read_rgb(truth.images[key]), read_grey(truth.masks[key])
                views.append(held_out_view(capture, frame, caricature, surface, *images))
        return views
