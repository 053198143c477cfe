"""The additions that CONTRIBUTING.md describes need the files that it names and no others."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from planted_faults import FAST, copy_checkout

pytestmark = [pytest.mark.docs, pytest.mark.slow]
OF_VARIANTS = ("tests/config", "tests/test_documents.py", "-k", "variant or preset or reference or document")
"""Tests that read all variants, or what is written of them."""
REFERENCE = {"--reference": "docs/configuration.md", "--schema": "docs/configuration.schema.json"}
DOCUMENT = Path(__file__).parents[2] / "CONTRIBUTING.md"


class Checkout:
    """A copy of the checkout that somebody adds something to."""

    def __init__(self, root: Path):
        copy_checkout(root)
        self.root, self.environment = root, os.environ | {"PYTHONPATH": str(root)}

    def insert(self, file: str, before: str, text: str) -> None:
        """Insert a text before the only place where another one stands."""
        old = (self.root / file).read_text("utf-8")
        assert old.count(before) == 1, (file, before)
        (self.root / file).write_text(old.replace(before, text + before), "utf-8")

    def append(self, file: str, text: str) -> None:
        """Append a text."""
        with (self.root / file).open("a", encoding="utf-8") as stream:
            stream.write(text)

    def run(self, *command: str) -> str:
        """What `python -m ...` prints, which must succeed."""
        line = [sys.executable, "-m", *command]
        done = subprocess.run(line, cwd=self.root, env=self.environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    def write_reference(self) -> None:
        """Write the reference of the settings again."""
        for option, file in REFERENCE.items():
            (self.root / file).write_text(self.run("carigs", "settings", option), "utf-8")

    def check(self, *tests: str) -> None:
        """Run the fast tests of these files and folders; further arguments choose among them."""
        self.run("pytest", "-m", FAST, "-p", "no:cacheprovider", "--tb=short", *tests)


@pytest.fixture
def checkout(tmp_path) -> Checkout:
    return Checkout(tmp_path)


def section(title: str) -> str:
    """The text of the section that begins so."""
    (found,) = re.findall(rf"^## {title}.*?$(.*?)(?=^## |\Z)", DOCUMENT.read_text("utf-8"), re.MULTILINE | re.DOTALL)
    return found


def test_a_variant(checkout):
    (example,) = re.findall(r"```yaml\n(.*?)```", section("How to add a variant"), re.DOTALL)
    (checkout.root / "conf/variant/more_outlines.yaml").write_text(example, "utf-8")
    checkout.write_reference()
    checkout.check(*OF_VARIANTS)


def test_a_mask_flag(checkout):
    checkout.insert(
        "carigs/settings/mask_flags.py", "\n\nMASK_FLAGS =",
        '    NOSE = 8192\n    """Triangles of the region `nose`."""\n',
    )  # fmt: skip
    checkout.insert(
        "carigs/gtstar/mask_flags.py", "    brows = brow_faces(",
        '    flags[model.face_region("nose")] |= MaskFlag.NOSE.value\n',
    )  # fmt: skip
    checkout.append("tests/gtstar/test_mask_flags.py", '''

def test_the_nose_is_flagged():
    model = replace(ball_model(), regions={"nose": np.unique(ball_model().faces[:9])})
    flags = face_mask_flags(model, Gtstar())
    assert ((flags & MaskFlag.NOSE.value > 0) == model.face_region("nose")).all() and flags.any()
''')  # fmt: skip
    checkout.write_reference()
    checkout.check("tests/gtstar/test_mask_flags.py", *OF_VARIANTS[:-1], f"mask_flags or {OF_VARIANTS[-1]}")


def test_a_metric_against_the_truth(checkout):
    checkout.insert(
        "evaluation/metrics/image_quality.py", "\n\nIMAGE_METRICS =",
        '''

def absolute_error(
    image: Float64[np.ndarray, "h w 3"], truth: Float64[np.ndarray, "h w 3"]
) -> Float64[np.ndarray, "h w"]:
    """Mean over the channels of the absolute difference.

    Args:
        image: Colours in [0, 1].
        truth: Colours in [0, 1].

    Returns:
        The difference at each pixel.
    """
    return np.abs(image - truth).mean(axis=2)
''',
    )  # fmt: skip
    file = checkout.root / "evaluation/metrics/image_quality.py"
    old = "ImageMetric(ssim_map, region_mean)}"
    assert old in file.read_text("utf-8")
    added = f'{old[:-1]}, "l1": ImageMetric(absolute_error, region_mean)}}'
    file.write_text(file.read_text("utf-8").replace(old, added), "utf-8")
    checkout.insert(
        "evaluation/metrics/catalogue.py", '    "ssim": Metric(',
        '    "l1": Metric("L1", "lower", 4, "", "mean absolute difference", "truth"),\n',
    )  # fmt: skip
    checkout.append("tests/evaluation/metrics/test_image_quality.py", '''

def test_the_absolute_error_of_a_constant_difference():
    from evaluation.metrics.image_quality import IMAGE_METRICS

    values = IMAGE_METRICS["l1"].pixel_map(np.full((4, 4, 3), 0.5), np.full((4, 4, 3), 0.25))
    np.testing.assert_allclose(values, 0.25)
''')  # fmt: skip
    checkout.check("tests/evaluation/metrics/test_image_quality.py", "tests/evaluation/tables")


def test_a_stress_case(checkout):
    checkout.insert(
        "tests/stress/metrics.py", "def cases(",
        '''def equal_numbers() -> Iterator[Measure]:
    """A difference that is 0."""
    yield Measure("difference", 0.0, 1e-12)


''',
    )  # fmt: skip
    checkout.insert(
        "tests/stress/metrics.py", '    yield Case("regions of a head model that are empty"',
        '    yield Case("equal numbers", equal_numbers)\n',
    )  # fmt: skip
    rows = checkout.root / "rows.csv"
    checkout.environment["PYTHONPATH"] += f":{checkout.root / 'tests'}"
    checkout.run("stress.metrics", str(rows))
    assert re.search(r"^.*equal numbers,.*right", rows.read_text("utf-8"), re.MULTILINE)


def test_a_setting_in_the_trade_offs(checkout):
    checkout.insert(
        "evaluation/benchmarks/training_trade_offs.py", '    *(f"capture.toy.width=',
        '    *(f"train.position_lr={rate:g}" for rate in (0.0001, 0.001)),\n',
    )  # fmt: skip
    checkout.insert(
        "evaluation/trade_offs/knobs.py", "\n\ndef _chosen(", '    yield _training_knob("train.position_lr")\n'
    )
    checkout.check("tests/evaluation/trade_offs")


def test_a_head_model(checkout):
    file = checkout.root / "carigs/head/plain_head.py"
    file.write_text('''"""Heads of the format `plain`: arrays with names of their own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np


def is_plain(arrays: Mapping[str, Any]) -> bool:
    """Whether arrays are those of a plain head.

    Args:
        arrays: Arrays by name.

    Returns:
        Whether they have its names.
    """
    return "points" in arrays


def plain_arrays(arrays: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Convert a plain head to the arrays of `carigs.head.model_arrays`.

    Args:
        arrays: Arrays of its file.

    Returns:
        The arrays of a head model.
    """
    renamed = {"points": "v_template", "triangles": "faces"}
    return {renamed.get(name, name): value for name, value in arrays.items()}
''', "utf-8")  # fmt: skip
    checkout.insert(
        "carigs/head/model.py", "        if is_gnm(arrays):",
        "        if is_plain(arrays):\n            arrays = plain_arrays(arrays)\n",
    )  # fmt: skip
    checkout.insert(
        "carigs/head/model.py", "from carigs.head.model_arrays import",
        "from carigs.head.plain_head import is_plain, plain_arrays\n",
    )  # fmt: skip
    (checkout.root / "tests/head/test_plain_head.py").write_text('''import numpy as np
from miniature import ball_model

from carigs.head import HeadModel


def test_a_plain_head_moves_as_its_equations_say(tmp_path):
    ball = ball_model()
    ball.save(tmp_path / "ball.npz")
    with np.load(tmp_path / "ball.npz") as saved:
        arrays = dict(saved)
    plain = {{"v_template": "points", "faces": "triangles"}.get(name, name): value for name, value in arrays.items()}
    np.savez(tmp_path / "plain.npz", **plain)
    read = HeadModel.load(tmp_path / "plain.npz")
    np.testing.assert_array_equal(read.v_template, ball.v_template)
    np.testing.assert_array_equal(read.faces, ball.faces)
''', "utf-8")  # fmt: skip
    checkout.check("tests/head/test_plain_head.py", "tests/head/test_forward.py")


def test_a_stage(checkout):
    (checkout.root / "carigs/settings/frame_list.py").write_text('''"""Settings of the list of frames."""

from __future__ import annotations

from dataclasses import dataclass

from carigs.settings.option import Section, option


@dataclass
class FrameList(Section, key="frame_list"):
    """What the list of frames names."""

    split: str = option("train", choices=("train", "val", "test"))
    """Frames that are listed."""
''', "utf-8")  # fmt: skip
    settings = "carigs/settings/__init__.py"
    checkout.insert(settings, "from carigs.settings.gtstar", "from carigs.settings.frame_list import FrameList\n")
    checkout.insert(
        settings, "    hair: Hair = field", "    frame_list: FrameList = field(default_factory=FrameList)\n"
    )
    (checkout.root / "carigs/stages/frame_list.py").write_text('''"""Stage `frame_list`: the names of frames."""

from __future__ import annotations

from pathlib import Path

from carigs.capture import Capture
from carigs.settings.frame_list import FrameList
from carigs.system.files import writing


def frame_list(settings: FrameList, *, capture: Path, names: Path, threads: int = 1) -> None:
    """List the frames of a split.

    Args:
        settings: The split.
        capture: Input: the index of the capture.
        names: Output: a name per line.
        threads: Not used.
    """
    found = [frame.name for frame in Capture.load(capture).split(settings.split)]
    with writing(names) as part:
        part.write_text("\\n".join(found))
    print(f"{len(found)} frames")
''', "utf-8")  # fmt: skip
    checkout.insert("workflow/rules/avatar.smk", "rule hair:\n", '''rule frame_list:
    input:
        settings="results/{study}/settings/frame_list/subject={subject}.yaml",
        capture="results/{study}/{subject}/capture.json",
    output:
        names="results/{study}/{subject}/frames.txt",
    log:
        "results/{study}/log/frame_list/{subject}.log",
    conda:
        "../../environment.yml"
    params:
        plan=plan("frame_list", "subject"),
    script:
        "../scripts/stage.py"


''')  # fmt: skip
    checkout.insert(
        "carigs/planning/costs.py", '        case "hair":', '        case "frame_list":\n            work = 0.1\n'
    )
    checkout.write_reference()
    checkout.check(
        "tests/config/test_schema.py", "tests/config/test_settings_paths.py", "tests/runs/test_plan.py",
        "tests/runs/test_sources.py",
    )  # fmt: skip
    target = "results/toy/toy/frames.txt"
    small = "capture.toy.width=16 capture.toy.height=20 capture.toy.supersampling=1"
    checkout.run("snakemake", "--cores", "2", "--config", f"hydra={small}", "--", target)
    made = checkout.root / target
    names = made.read_text("utf-8").split()
    assert len(names) == len({*names}) > 0
    checkout.run("snakemake", "--cores", "2", "--config", f"hydra={small} frame_list.split=test", "--", target)
    assert not {*made.read_text("utf-8").split()} & {*names}
