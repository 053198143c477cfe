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

    def write_reference(self) -> None:
        """Write the reference of the settings again."""
        for option, file in REFERENCE.items():
            command = [sys.executable, "-m", "carigs", "settings", option]
            done = subprocess.run(
                command, cwd=self.root, env=self.environment, capture_output=True, text=True, check=True
            )
            (self.root / file).write_text(done.stdout, "utf-8")

    def check(self, *tests: str) -> None:
        """Run the fast tests of these files and folders."""
        command = [sys.executable, "-m", "pytest", "-m", FAST, "-p", "no:cacheprovider", "--tb=short", *tests]
        done = subprocess.run(command, cwd=self.root, env=self.environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr


@pytest.fixture
def checkout(tmp_path) -> Checkout:
    return Checkout(tmp_path)


def section(title: str) -> str:
    """The text of the section that begins so."""
    (found,) = re.findall(rf"^## {title}.*?$(.*?)(?=^## |\Z)", DOCUMENT.read_text("utf-8"), re.MULTILINE | re.DOTALL)
    return found


def test_a_variant(checkout):
    (example,) = re.findall(r"```yaml\n(.*?)```", section("How to add a variant"), re.DOTALL)
    (checkout.root / "conf/variant/more_ssim.yaml").write_text(example, "utf-8")
    checkout.write_reference()
    checkout.check("tests/config", "tests/test_documents.py")


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
    checkout.check("tests/config", "tests/gtstar", "tests/test_documents.py")


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
    environment = checkout.environment | {"PYTHONPATH": f"{checkout.root}:{checkout.root / 'tests'}"}
    command = [sys.executable, "-m", "stress.metrics", str(rows)]
    done = subprocess.run(command, cwd=checkout.root, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert re.search(r"^.*equal numbers,.*right", rows.read_text("utf-8"), re.MULTILINE)
