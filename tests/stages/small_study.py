"""A study of one subject, made by calling the functions of the stages: from the index of a capture to the report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from importlib import import_module
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf

from carigs.config import yaml_text
from carigs.config.literals import literal
from carigs.settings import (
    CaptureSettings,
    Card,
    Exaggerate,
    Figures,
    Gtstar,
    Hair,
    Html,
    Metrics,
    Render,
    Report,
    Tabulate,
    Train,
    Truth,
)

METHOD = "alternating"


def small_settings() -> dict[str, Any]:
    """Sections with which a study of a miniature takes seconds: a training of one step, no networks."""
    return {
        "capture": CaptureSettings(),
        "exaggerate": Exaggerate(path_nodes=2),
        "hair": Hair(),
        "truth": Truth(),
        "train": Train(iterations=1, gtstar_probability=0, relight_surfels=False, mouth_surfels=50, hair_layers=1),
        "render": Render(orbit_frames=2),
        "metrics": Metrics(embeddings=(), lpips=()),
        "tabulate": Tabulate(),
        "figures": Figures(),
        "card": Card(machine=False),
        "html": Html(),
        "report": Report(),
    }


@dataclass
class SmallStudy:
    """What a study is made of; `make` makes it."""

    folder: Path
    capture: Path
    """Index of the capture."""
    subject: str = "ball"
    variants: Sequence[str] = (METHOD,)
    seeds: Sequence[int] = (0,)
    levels: Sequence[float] = (0.0, 0.25)
    gamma: float = 0.25
    settings: dict[str, Any] = field(default_factory=small_settings)

    def make(self) -> SmallStudy:
        """Make everything up to the report."""
        self.settings["exaggerate"] = replace(self.settings["exaggerate"], gamma=self.gamma)
        self.settings["render"] = replace(self.settings["render"], levels=tuple(self.levels))
        common = {"capture": self.capture, "path": self._file("path.npz")}
        self._run("exaggerate", **common)
        self._run("hair", capture=self.capture, found=self._file("hair.npz"))
        truths = [self._file(f"truth/level={level:g}/truth.json") for level in self.levels]
        for level, index in zip(self.levels, truths, strict=True):
            self._run("truth", **common, level=level, frames=index.parent / "frames", index=index)
        for variant in self.variants:
            for seed in self.seeds:
                self._avatar(variant, seed, common, truths)
        table, markdown, latex = (self.folder / f"table.{suffix}" for suffix in ("csv", "md", "tex"))
        records = [self._of(variant, seed, "metrics.csv") for variant in self.variants for seed in self.seeds]
        self._run("tabulate", records=records, table=table, markdown=markdown, latex=latex)
        shown = {"capture": self.capture, "frames": self._shown("frames"), "truths": truths}
        self._run(
            "figures", **shown, path=common["path"], hair=self._file("hair.npz"), variants=list(self.variants),
            levels=list(self.levels), avatar=self._method_file("avatar.npz"), gtstar=asdict(Gtstar()),
            mask_flags=list(Train().mask_flags), folder=self.figures,
        )  # fmt: skip
        self._pages(table, truths)
        return self

    @property
    def figures(self) -> Path:
        """Folder of the figures."""
        return self.folder / "figures" / self.subject / f"gamma={self.gamma:g}"

    @property
    def drawn(self) -> set[str]:
        """Names of the figures that were drawn."""
        return {file.stem for file in self.figures.glob("*.png")}

    @property
    def left_out(self) -> dict[str, str]:
        """Reasons by name of the figures that were not."""
        file = self.figures / "left_out.txt"
        return dict(line.split(": ", 1) for line in file.read_text("utf-8").splitlines()) if file.is_file() else {}

    @property
    def report(self) -> str:
        """The page."""
        return (self.folder / "report.html").read_text("utf-8")

    def _avatar(self, variant: str, seed: int, common: dict[str, Path], truths: list[Path]) -> None:
        avatar, ply, log, frames, records = (
            self._of(variant, seed, name) for name in ("avatar.npz", "avatar.ply", "log.csv", "frames", "metrics.csv")
        )
        self.settings["train"] = replace(self.settings["train"], seed=seed)
        self._run(
            "train", **common, hair=self._file("hair.npz"), targets=None, avatar=avatar, ply=ply, log=log, resume_key=""
        )
        self._run("render", **common, avatar=avatar, frames=frames, resume_key="")
        self._run(
            "metrics", **common, frames=frames, truths=truths, study="small", subject=self.subject, variant=variant,
            seed=seed, gamma=self.gamma, levels=list(self.levels), embeddings=str(self.folder / "embeddings"),
            records=records,
        )  # fmt: skip

    def _pages(self, table: Path, truths: list[Path]) -> None:
        levels, names = [f"{level:g}" for level in self.levels], {"subjects": [self.subject]}
        names["variants"] = list(self.variants)
        common = {"table": table, "captures": [self.capture], "made_with": self._settings_files(), **names}
        common |= {"levels": levels, "logs": str(self.folder / "log")}
        avatars = [self._of(variant, seed, "avatar.npz") for variant in self.variants for seed in self.seeds]
        card, markdown = self.folder / "card.json", self.folder / "card.md"
        seeds = [f"{seed}" for seed in self.seeds]
        self._run("card", **common, avatars=avatars, seeds=seeds, gamma=f"{self.gamma:g}", card=card, markdown=markdown)
        page = self._method_file("avatar.html")
        if page:
            self._run("html", avatar=self._method_file("avatar.npz"), title=self.subject, page=page)
        self._run(
            "report", **common, card=card, figures=[self.figures], frames=self._shown("frames"), truths=truths,
            training=self._shown("log.csv"), avatars=[page] if page else None, page=self.folder / "report.html",
        )  # fmt: skip

    def _settings_files(self) -> list[Path]:
        files = []
        for stage in ("capture", "train", "render", "truth", "metrics", "tabulate", "figures"):
            point = "all" if stage == "tabulate" else f"subject={self.subject}"
            files.append(self.folder / f"settings/{stage}/{point}.yaml")
            files[-1].parent.mkdir(parents=True)
            section = OmegaConf.structured(type(self.settings[stage]))
            found = OmegaConf.merge(section, literal(asdict(self.settings[stage])))
            files[-1].write_text(yaml_text(found), encoding="utf-8")
        return files

    def _run(self, stage: str, **keywords: Any) -> None:
        getattr(import_module(f"carigs.stages.{stage}"), stage)(self.settings[stage], **keywords)

    def _file(self, name: str) -> Path:
        file = self.folder / self.subject / f"gamma={self.gamma:g}" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        return file

    def _of(self, variant: str, seed: int, name: str) -> Path:
        return self._file(f"{variant}/seed={seed}/{name}")

    def _shown(self, name: str) -> list[Path]:
        """A file of the first seed of each variant."""
        return [self._of(variant, self.seeds[0], name) for variant in self.variants]

    def _method_file(self, name: str) -> Path | None:
        return self._of(METHOD, self.seeds[0], name) if METHOD in self.variants else None
